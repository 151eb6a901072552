"""A drive as it is recorded: products that fit each other, and going on after a stop."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files import atomic
from instdrive_core.formats.registry import save_scene
from instdrive_core.progress import CancelledError, report_to
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.recording.drive import Drive
from instdrive_core.recording.folder import MANIFEST, is_view_whole, read_color, read_id_map, read_manifest
from instdrive_core.recording.plan import RecordOptions, plan_views
from instdrive_core.recording.record import record_drive


def make_scene():
    scene = random_scene(count=300)
    scene.gaussians.log_scales[:] = -1.2
    scene.gaussians.opacity_logits[:] = 3
    return scene


def make_drive(scene, **options):
    return Drive(scene, plan_views(scene, RecordOptions(**options)))


@pytest.fixture(scope="module")
def scene():
    return make_scene()


@pytest.fixture(scope="module")
def recorded(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording") / "out"
    record_drive(folder, make_drive(scene))
    return folder


def read_pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture)


def list_files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_color_masks_and_depth_are_what_the_editor_shows(scene, recorded):
    view = scene.views[2]
    shown = view_scene(scene, view.camera, view.time)
    color = read_color(recorded / "color/front_camera/02.png") / 255
    np.testing.assert_allclose(color, np.clip(shown.color, 0, 1), atol=0.51 / 255)
    ids = read_id_map(recorded / "instances/front_camera/02.png")
    np.testing.assert_array_equal(ids, build_instance_map(scene, shown))
    depth = np.load(recorded / "depth/front_camera/02.npz")["depth"]
    there = shown.alpha >= 0.5
    assert there.any()
    np.testing.assert_array_equal(depth[there], shown.depth[there])
    millimetres = read_pixels(recorded / "depth/front_camera/02.png")
    assert millimetres.dtype == np.uint16
    np.testing.assert_allclose(millimetres[there], np.minimum(depth[there] * 1000, 65535), atol=0.51)
    assert not millimetres[~there].any()


def test_classes_follow_instances(recorded):
    manifest = read_manifest(recorded)
    numbers = {entry["id"]: entry["class_number"] for entry in manifest["instances"]}
    assert set(numbers.values()) == {0, 1}
    ids = read_id_map(recorded / "instances/front_camera/00.png")
    classes = read_pixels(recorded / "classes/front_camera/00.png")
    np.testing.assert_array_equal(classes, np.vectorize(lambda one: numbers.get(one, 0))(ids))


def test_boxes_in_pictures_hold_the_masks(recorded):
    content = json.loads((recorded / "views/front_camera/01.json").read_text())
    ids = read_id_map(recorded / "instances/front_camera/01.png")
    assert {entry["id"] for entry in content["objects"]} >= set(np.unique(ids).tolist()) - {0}
    for entry in content["objects"]:
        mask = ids == entry["id"]
        assert entry["pixels_visible"] == mask.sum()
        if mask.any():
            rows, columns = np.nonzero(mask)
            x, y, width, height = entry["box_visible"]
            assert (x, y) == (columns.min(), rows.min())
            assert (x + width, y + height) == (columns.max() + 1, rows.max() + 1)
            amodal = entry["box_amodal"]
            assert amodal[0] <= x
            assert amodal[1] <= y
            assert 0 < entry["visibility"] <= 1


def test_an_actor_has_the_box_of_its_track_and_its_speed(scene, recorded):
    content = json.loads((recorded / "moments/02.json").read_text())
    moving = {box["id"]: box for box in content["boxes"] if box["from"] == "track"}
    assert moving
    for box in moving.values():
        node = next(entry.node for entry in scene.table if entry.id == box["id"])
        track = scene.actors[node - 1]
        np.testing.assert_allclose(box["center"], track.interpolate_pose(0.2)[:3, 3], atol=1e-5)
        assert list(box["size"].values()) == pytest.approx(track.dimensions.tolist())
        ends = track.world_from_box[[0, -1], :3, 3]  # it goes straight, at one speed
        expected = (ends[1] - ends[0]) / (track.times[-1] - track.times[0])
        np.testing.assert_allclose(box["velocity"], expected, atol=1e-4)


def test_what_was_deleted_is_in_no_product(scene, tmp_path):
    document = Document(make_scene())
    gone = int(np.unique(read_first_ids(scene))[-1])
    document.apply(DeleteInstances((gone,)))
    edited = bake_document(document)
    record_drive(tmp_path / "out", make_drive(edited, first=0, last=1))
    assert gone not in read_id_map(tmp_path / "out/instances/front_camera/00.png")
    assert gone not in {entry["id"] for entry in read_manifest(tmp_path / "out")["instances"]}
    for name in ("moments/00.json", "views/front_camera/00.json"):
        content = json.loads((tmp_path / "out" / name).read_text())
        assert gone not in {entry["id"] for entry in content.get("boxes", content.get("objects"))}


def read_first_ids(scene):
    view = scene.views[0]
    return build_instance_map(scene, view_scene(scene, view.camera, view.time))


def test_a_stopped_recording_goes_on_and_ends_the_same(scene, recorded, tmp_path):
    folder, drive = tmp_path / "out", make_drive(scene)

    def stop(share):
        if share > 0.5:
            raise CancelledError("stopped")

    with pytest.raises(CancelledError), report_to(stop):
        record_drive(folder, drive)
    assert not (folder / MANIFEST).exists()
    with pytest.raises(DataError, match="no finished recording"):
        read_manifest(folder)
    kept = folder / "color/front_camera/00.png"
    stamp = kept.stat().st_mtime_ns
    record_drive(folder, drive)
    assert kept.stat().st_mtime_ns == stamp, "a whole view was recorded again"
    assert list_files(folder) == list_files(recorded)


def test_a_view_with_a_short_file_is_recorded_again(scene, recorded, tmp_path):
    folder, drive = tmp_path / "out", make_drive(scene)
    shutil.copytree(recorded, folder)
    broken = folder / "depth/front_camera/03.png"
    broken.write_bytes(broken.read_bytes()[:50])
    assert not is_view_whole(folder, drive.views[3])
    record_drive(folder, drive)
    assert list_files(folder) == list_files(recorded)


def test_another_scene_is_not_mixed_in(scene, recorded):
    other = make_scene()
    other.gaussians.sh_dc[0] += 1
    with pytest.raises(DataError, match="another scene, or of other views"):
        record_drive(recorded, make_drive(other))
    with pytest.raises(DataError, match="another scene, or of other views"):
        record_drive(recorded, make_drive(scene, last=2))


def test_a_full_disk_says_so_and_leaves_nothing_half(scene, tmp_path, monkeypatch):
    folder, drive = tmp_path / "out", make_drive(scene)
    real, calls = atomic.os.fsync, []

    def fill_up(descriptor):
        calls.append(descriptor)
        if len(calls) > 20:
            raise OSError(28, "No space left on device")
        real(descriptor)

    monkeypatch.setattr(atomic.os, "fsync", fill_up)
    with pytest.raises(DataError, match=r"No space left on device.*Free some space"):
        record_drive(folder, drive)
    assert not (folder / MANIFEST).exists()
    monkeypatch.undo()
    whole = [view for view in drive.views if is_view_whole(folder, view)]
    assert 0 < len(whole) < len(drive.views)
    record_drive(folder, drive)
    assert all(is_view_whole(folder, view) for view in drive.views)


def test_places_that_cannot_be_recorded_into_are_named(scene, tmp_path):
    drive = make_drive(scene)
    (tmp_path / "file").write_text("x")
    with pytest.raises(DataError, match="is a file"):
        record_drive(tmp_path / "file", drive)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/mine.txt").write_text("x")
    with pytest.raises(DataError, match="not empty and holds no recording"):
        record_drive(tmp_path / "full", drive)
    with pytest.raises(DataError, match="cannot be written"):
        record_drive(tmp_path / "file/below", drive)


def test_parts_that_do_not_exist_are_named(scene):
    with pytest.raises(OptionError, match="no camera 'roof'; it has front_camera"):
        plan_views(scene, RecordOptions(cameras=("roof",)))
    with pytest.raises(OptionError, match="there are the time steps 0–4"):
        plan_views(scene, RecordOptions(first=90))
    with pytest.raises(OptionError, match="the width is 2"):
        plan_views(scene, RecordOptions(width=2))


def test_the_command_records_at_another_size(scene, tmp_path, capsys):
    save_scene(tmp_path / "run", scene)
    asked = ["simulate", str(tmp_path / "run"), "-o", str(tmp_path / "out"), "--width", "32", "--last", "1"]
    assert main(asked) == 0
    assert "2 views, 2 moments" in capsys.readouterr().out
    assert read_color(tmp_path / "out/color/front_camera/01.png").shape == (24, 32, 3)
    assert main([*asked, "--first", "9"]) == 2
