"""What was seen moving is listed with the reason why it was not rebuilt, and where to look."""

from procedural_street import procedural_street

from instdrive_app.panels.instances.seen_moving import explain_mover, find_first_view, name_mover
from instdrive_core.scene.seen_moving import SeenMover, Sighting

BOX = (0.25, 0.5, 0.5, 0.75)


def test_the_text_says_where_when_and_why():
    text = explain_mover(SeenMover("left", tuple(Sighting(step, BOX) for step in (3, 5, 6))))
    assert "Seen in 3 photos of left, steps 3 to 6." in text
    assert "25–50 % of the width and 50–75 % of the height" in text
    assert "rebuilt where a clip has LiDAR" in text
    assert "1 photo of left, step 3." in explain_mover(SeenMover("left", (Sighting(3, BOX),)))


def test_names_say_the_class_where_it_is_known():
    assert name_mover(SeenMover("left", (), "Car"), 2) == "Car 2"
    assert name_mover(SeenMover("left", ()), 2) == "Something 2"


def test_the_first_photo_that_the_scene_has_is_found():
    views = procedural_street().views
    known = views[3]
    mover = SeenMover(known.name, (Sighting(999, BOX), Sighting(known.index, BOX)))
    assert find_first_view(mover, views) == 3
    assert find_first_view(SeenMover("no camera", mover.sightings), views) is None
