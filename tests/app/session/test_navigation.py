"""Where the user looks from: orbiting keeps above the ground, and the first view comes back."""

from dataclasses import replace

import numpy as np
from session_driver import finish

from instdrive_app import camera
from instdrive_app.session.export_kinds import ExportChoice
from instdrive_app.state import Viewpoint
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.camera import PhotoLag, look_at


def test_orbiting_up_stays_above_the_ground_unless_switched_off(session):
    """One long drag to the top of the window, with the pivot on the road."""
    start = look_at(np.array([0.0, -2.0, 2.0]), np.array([0.0, 4.0, 0.0]))
    view = Viewpoint(start, session.state.viewpoint.lens, 6.3)
    for _ in range(100):
        view = session.navigation.orbit(view, 0.003, 0.02)
        assert view.position[2] > 0.1
    assert view.position[2] < 0.6, "it goes down to the clearance"
    assert view.forward[1] > 0.9
    session.state.stay_above_ground = False
    for _ in range(100):
        view = session.navigation.orbit(view, 0.0, 0.02)
    assert view.position[2] < -2.0
    session.state.stay_above_ground = True
    deep = view.position[2]
    assert session.navigation.orbit(view, 0.0, -0.1).position[2] > deep, "back up is free"


def test_the_start_view_comes_back(session):
    start = session.state.viewpoint
    session.navigation.look_down(())
    session.navigation.set_time(1.0)
    assert session.actions.run("view.start")
    np.testing.assert_array_equal(session.state.viewpoint.world_from_camera, start.world_from_camera)
    assert session.state.dataset_view == 0
    assert session.state.time == 0.0


def test_a_photos_lag_comes_and_goes_with_its_camera(session):
    lag = PhotoLag.look_from(np.zeros(3), 0.3, -0.1, -0.1, -0.05)
    views = [replace(view, camera=replace(view.camera, lag=lag)) for view in session.document.scene.views]
    session.show(Document(replace(session.document.scene, views=tuple(views))))
    session.navigation.look_through(1)
    assert session.state.viewpoint.lag == lag
    session.navigation.set_time(session.document.scene.views[-1].time)
    assert session.state.viewpoint.lag == lag
    session.navigation.look_from(camera.look(session.state.viewpoint, 0.1, 0.0))
    assert session.state.viewpoint.lag is None


def test_an_exported_ply_opens_as_it_was_left(session, tmp_path):
    session.navigation.look_down(())
    left = session.state.viewpoint
    session.export.write(tmp_path / "street.ply", ExportChoice("scene"))
    finish(session)
    session.files.open(tmp_path / "street.ply")
    finish(session)
    np.testing.assert_allclose(session.state.viewpoint.world_from_camera, left.world_from_camera)
    assert session.document.scene.sky is not None
    assert session.orientation.estimate is None, "nobody asks which way is up"


def test_framing_what_is_not_there_goes_to_when_it_is_and_says_so(session):
    scene = session.document.scene
    track = scene.actors[0]
    late = replace(track, times=track.times[2:], world_from_box=track.world_from_box[2:])
    session.show(Document(replace(scene, actors=(late,))))
    driving = next(each.id for each in scene.table if each.node)
    session.navigation.frame((driving,))
    assert session.state.time == 1.0
    assert "1.00 s" in session.messages.log[-1].text
    shown = session.state.viewpoint.fit_camera(480, 270).project(late.world_from_box[:1, :3, 3])[0][0]
    assert np.abs(shown - [240, 135]).max() < 60
    said = len(session.messages.log)
    session.navigation.frame((driving,))
    assert len(session.messages.log) == said


def test_a_place_of_the_map_is_looked_at_from_a_photo_that_shows_it(session):
    session.navigation.go_to_place(0.5, 14.0)

    def find_looked_at():
        view = session.state.viewpoint
        return (view.position - view.position[2] / view.forward[2] * view.forward)[:2]

    view = session.state.viewpoint
    places = [each.camera.world_from_camera[:3, 3] for each in session.document.scene.views]
    assert min(np.linalg.norm(view.position - place) for place in places) < 1e-9
    np.testing.assert_allclose(find_looked_at(), (0.5, 14.0), atol=0.5)
    session.show(Document(replace(session.document.scene, views=())))
    session.navigation.go_to_place(0.5, 14.0)
    np.testing.assert_allclose(find_looked_at(), (0.5, 14.0), atol=0.5)
    assert session.state.viewpoint.zoom == 1.0


def test_everything_is_shown_from_where_the_rig_was_at_the_shown_time(session):
    session.navigation.look_down(())
    session.navigation.set_time(1.0)
    session.navigation.frame(())
    views = [view for view in session.document.scene.views if view.time == 1.0]
    place = session.state.viewpoint.position
    assert min(np.linalg.norm(place - view.camera.position) for view in views) < 1e-9
    assert session.state.dataset_view is None
