"""Every kind of export from the editor, without a window."""

import json

import numpy as np
import pytest
from PIL import Image
from procedural_street import DRIVING_CAR, FIRST_CAR
from session_driver import finish

from instdrive_app.messages import Level
from instdrive_app.panels.dialogs.export import ExportOptions, find_ending, replace_ending
from instdrive_app.session.export_kinds import KINDS, ExportChoice
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.formats import read_back
from instdrive_core.formats.objects.poses import read_poses
from instdrive_core.formats.registry import FORMATS, open_scene
from instdrive_core.instances.colormap import ids_from_colors

CARS = (FIRST_CAR, FIRST_CAR + 1)


def export(session, path, **choice):
    """Export and wait; returns what the user is told."""
    finish(session)  # what is told of a deletion comes first
    session.export.write(path, ExportChoice(**choice))
    finish(session)
    return session.messages.log[-1]


@pytest.mark.parametrize("name", ["cars.spz", "cars.ply", "cars.splat", "cars.compressed.ply", "cars.sibr.ply", "cars"])
def test_the_selection_in_every_format(session, street, tmp_path, name):
    session.selection.select((*CARS, DRIVING_CAR))
    told = export(session, tmp_path / name, what="selection")
    count = len(street.find_rows((*CARS, DRIVING_CAR)))
    assert told.text == f"Exported {count:,} splats to {tmp_path / name}, read back and compared"
    found = open_scene(tmp_path / name)
    assert len(found) == count
    assert len(found.actors) == (name == "cars")
    assert session.files.last_export == tmp_path / name


def test_selected_splats_are_exported_and_no_others_of_their_instances(session, street, tmp_path):
    rows = street.find_rows((FIRST_CAR,))[:40]
    session.history.apply(SelectRows(rows))
    export(session, tmp_path / "some.ply", what="selection")
    found = open_scene(tmp_path / "some.ply")
    np.testing.assert_array_equal(found.gaussians.means, street.scene.gaussians.means[rows])


@pytest.mark.parametrize("name", ["street.ply", "street"])
def test_what_the_edits_build_on_is_not_written_over(session, street, tmp_path, name):
    export(session, tmp_path / name)
    session.files.open(tmp_path / name)
    finish(session)
    session.deletion.delete((FIRST_CAR,))
    finish(session)
    refused = export(session, tmp_path / ".." / tmp_path.name / name)
    assert refused.level is Level.ERROR
    assert "another name" in refused.text
    assert len(open_scene(tmp_path / name)) == len(session.document.scene), "it is as it was"
    assert export(session, tmp_path / f"other_{name}").level is Level.INFO


def test_one_file_per_selected_instance_or_of_all(session, tmp_path):
    session.selection.select(CARS)
    told = export(session, tmp_path / "cars", what="instances", suffix=".spz")
    assert "Exported 2 instances of" in told.text
    assert [entry["id"] for entry in listed(tmp_path / "cars")] == list(CARS)
    session.selection.clear()
    session.deletion.delete((FIRST_CAR,))
    export(session, tmp_path / "all", what="instances")
    assert {entry["id"] for entry in listed(tmp_path / "all")} == set(session.document.find_visible_instances())


def listed(folder):
    return json.loads((folder / "instances.json").read_text())["instances"]


def test_actors_with_their_poses(session, street, tmp_path):
    told = export(session, tmp_path / "actors", what="actors", suffix=".ply")
    assert "1 actor" in told.text
    track, _, splats = read_poses(tmp_path / "actors" / "001_Car.poses.json")
    found, rows = open_scene(splats), street.find_rows((DRIVING_CAR,))
    np.testing.assert_array_equal(found.gaussians.means, street.scene.gaussians.means[rows])
    np.testing.assert_allclose(track.world_from_box, street.scene.actors[0].world_from_box, atol=1e-7)


def test_a_folder_can_hold_the_shown_moment(session, street, tmp_path):
    session.navigation.set_time(1.0)
    export(session, tmp_path / "moment", keep_tracks=False)
    export(session, tmp_path / "tracks")
    assert (open_scene(tmp_path / "moment").actors, len(open_scene(tmp_path / "tracks").actors)) == ((), 1)
    export(session, tmp_path / "moment.usdc", keep_tracks=False)
    export(session, tmp_path / "tracks.usdc")
    assert (open_scene(tmp_path / "moment.usdc").actors, len(open_scene(tmp_path / "tracks.usdc").actors)) == ((), 1)


def test_sibr_files_under_any_name(session, tmp_path):
    export(session, tmp_path / "point_cloud.ply", sibr=True)
    header = (tmp_path / "point_cloud.ply").read_bytes()[:200].split(b"\n")
    assert header[2].startswith(b"element vertex")
    told = export(session, tmp_path / "street.spz", sibr=True)
    assert told.level is Level.INFO, "the switch is about .ply files only"


@pytest.mark.parametrize(("name", "hulls"), [("boxes.json", False), ("hulls.json", True), ("boxes.glb", False)])
def test_boxes_and_hulls(session, street, tmp_path, name, hulls):
    session.deletion.delete((FIRST_CAR,))
    told = export(session, tmp_path / name, what="objects", hulls=hulls)
    assert f"{'hulls' if hulls else 'boxes'} of" in told.text
    if name.endswith(".json"):
        entries = json.loads((tmp_path / name).read_text())["objects"]
        assert {entry["id"] for entry in entries} == set(street.find_visible_instances())
        assert any("hull" in entry for entry in entries) is hulls


@pytest.mark.parametrize("coco", [False, True])
def test_masks_of_the_photos(session, street, tmp_path, coco):
    told = export(session, tmp_path / "masks", what="masks", coco=coco)
    assert f"{len(street.scene.views)} photos" in told.text
    if coco:
        assert len(json.loads((tmp_path / "masks" / "panoptic.json").read_text())["images"]) == 8
    else:
        colors = np.array(Image.open(tmp_path / "masks" / "colors" / "front_camera" / "00.png"))
        assert FIRST_CAR in ids_from_colors(colors)


def test_pictures_leave_out_what_is_hidden(session, tmp_path):
    for name in ("all", "fewer"):
        assert export(session, tmp_path / f"{name}.png", what="view", scale=2.0).level is Level.INFO
        session.visibility.hide((FIRST_CAR,))
    both = [np.array(Image.open(tmp_path / f"{name}.png"), int) for name in ("all", "fewer")]
    lens = session.state.viewpoint.lens
    assert both[0].shape == (2 * lens.height, 2 * lens.width, 3)
    assert (np.abs(both[0] - both[1]).max(axis=2) > 20).mean() > 0.02
    told = export(session, tmp_path / "cameras", what="cameras")
    assert "8 pictures" in told.text
    assert len(list((tmp_path / "cameras" / "right_camera").glob("*.png"))) == 4


def test_a_bad_file_is_told_and_the_old_one_stays(session, tmp_path, monkeypatch):
    path = tmp_path / "street.spz"
    export(session, path)
    before = path.read_bytes()
    session.deletion.delete((FIRST_CAR,))
    monkeypatch.setattr(read_back, "find_loss", lambda *_: "x of splat 3 is 1 m, not 2 m")
    told = export(session, path)
    assert told.level is Level.ERROR
    assert "x of splat 3 is 1 m, not 2 m" in told.text
    assert "Nothing was replaced" in told.text
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["street.spz"]


def test_places_that_cannot_be_written_are_told(session, tmp_path):
    (tmp_path / "file").write_text("")
    told = export(session, tmp_path / "file" / "street.ply")
    assert told.level is Level.ERROR
    assert "cannot be written" in told.text


def test_the_dialog_begins_with_the_scene_and_proposes_names(session, street, tmp_path):
    session.files.path = tmp_path / "street.instdrive"
    options = ExportOptions()
    assert options.begin(session, "scene") == str(tmp_path / "street_edited.ply")
    assert session.export.amounts["scene"] == f"{len(street.scene):,} splats"
    assert "Nothing is selected" in with_choice(session, options, "selection").find_problem(tmp_path / "a.ply")
    session.selection.select((FIRST_CAR,))
    assert options.begin(session, "selection") == str(tmp_path / "street_parked_car_1.ply")
    assert not options.build_purpose(session).find_problem(tmp_path / "a.spz")
    for what, right, wrong in (
        ("instances", "parts", "parts.ply"),
        ("masks", "masks", "masks.json"),
        ("objects", "boxes.glb", "boxes.ply"),
        ("view", "view.png", "view"),
        ("scene", "folder", "scene.xyz"),
    ):
        purpose = with_choice(session, options, what)
        assert not purpose.find_problem(tmp_path / right), what
        assert purpose.find_problem(tmp_path / wrong), what
        assert session.export.propose_path_in(str(tmp_path / "x.ply")).parent == tmp_path


def with_choice(session, options, what):
    session.export.choice = ExportChoice(what)
    return options.build_purpose(session)


def test_endings_are_read_from_the_path_and_replaced_there():
    assert [find_ending(name) for name in ("/a/b.PLY", "b.compressed.ply", "c.sibr.ply", "/a.ply/folder", "x")] == [
        ".ply",
        ".compressed.ply",
        ".sibr.ply",
        "",
        "",
    ]
    assert replace_ending("/a/b.compressed.ply", ".spz") == "/a/b.spz"
    assert replace_ending("/a/b", ".splat") == "/a/b.splat"
    assert replace_ending("/a/b.ply", "") == "/a/b"
    assert replace_ending("/a/b.PLY", ".ply") == "/a/b.PLY"


def test_every_written_format_can_be_chosen():
    written = {fmt.suffix for fmt in FORMATS if fmt.suffix.startswith(".") and fmt.write is not None}
    assert set(KINDS["scene"].endings) == written
