"""The native format keeps everything, survives half-finished saves, and explains damage."""

import dataclasses
import json
import os
import shutil
import threading

import numpy as np
import pytest
from random_scene import assert_same_scene, random_scene

from instdrive_core.errors import DataError
from instdrive_core.formats.folder import scenes as scene_folder
from instdrive_core.formats.folder.scenes import read_scene_folder, write_scene_folder
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.scene import Scene, scene_from_gaussians
from instdrive_core.scene.seen_moving import SeenMover, Sighting


@pytest.mark.parametrize("options", [{}, {"actors": 0}, {"count": 1}, {"degree": 0, "features": 0}])
def test_round_trip_keeps_everything(tmp_path, options):
    scene = random_scene(**options)
    write_scene_folder(tmp_path / "run", scene)
    again = read_scene_folder(tmp_path / "run")
    assert_same_scene(again, scene)
    for mine, theirs in zip(scene.views, again.views, strict=True):
        names = ("name", "index", "time", "held_out")
        assert [getattr(mine, name) for name in names] == [getattr(theirs, name) for name in names]
        assert theirs.photo == os.path.abspath(mine.photo), "relative paths are meant from the working folder"
        np.testing.assert_array_equal(mine.camera.world_from_camera, theirs.camera.world_from_camera)
        np.testing.assert_array_equal(mine.camera.intrinsics, theirs.camera.intrinsics)
        assert (mine.camera.width, mine.camera.height) == (theirs.camera.width, theirs.camera.height)


def lagging_scene():
    """A scene whose first photo lags behind the LiDAR."""
    scene = exposed_scene()
    first, *others = scene.views
    lag = PhotoLag.look_from(np.array([1.0, 2.0, 0.5]), -1.2, -0.1, -0.1, -0.05)
    lagging = dataclasses.replace(first, camera=dataclasses.replace(first.camera, lag=lag))
    return dataclasses.replace(scene, views=(lagging, *others))


def test_lags_are_kept(tmp_path):
    write_scene_folder(tmp_path, lagging_scene())
    lags = [view.camera.lag for view in read_scene_folder(tmp_path).views]
    assert lags == [view.camera.lag for view in lagging_scene().views]
    assert lags[0] is not None


def exposed_scene(photos=4):
    """A scene whose photos have exposures."""
    rng = np.random.default_rng(5)
    keys = tuple(f"front_camera/{index:02d}" for index in range(photos))
    matrices = (np.eye(3, 4) + rng.normal(0, 0.1, (photos, 3, 4))).astype(np.float32)
    return dataclasses.replace(random_scene(), exposures=Exposures(keys, 0.1 * np.arange(photos), matrices))


@pytest.mark.parametrize("photos", [0, 4])
@pytest.mark.parametrize("half", [False, True])
def test_exposures_are_kept(tmp_path, photos, half):
    scene = exposed_scene(photos)
    write_scene_folder(tmp_path, scene, half)
    again = read_scene_folder(tmp_path).exposures
    assert again.keys == scene.exposures.keys
    tolerance = 1e-3 if half else 0
    np.testing.assert_allclose(again.times, scene.exposures.times, atol=tolerance)
    np.testing.assert_allclose(again.matrices, scene.exposures.matrices, atol=tolerance)
    assert (again.times.dtype, again.matrices.dtype) == (np.float64, np.float32)


def test_scenes_older_than_exposures_open_and_ply_files_have_none(tmp_path):
    write_scene_folder(tmp_path / "old", random_scene())
    manifest = json.loads((tmp_path / "old" / "scene.json").read_text())
    assert manifest.pop("exposures") is None
    (tmp_path / "old" / "scene.json").write_text(json.dumps(manifest))
    assert read_scene_folder(tmp_path / "old").exposures is None
    static = dataclasses.replace(exposed_scene(), actors=(), nodes=np.zeros(200, np.uint16))
    save_scene(tmp_path / "static.ply", static)
    assert open_scene(tmp_path / "static.ply").exposures is None


@pytest.mark.parametrize("node", [0, 99])
def test_instances_are_of_the_node_of_most_of_their_gaussians_whatever_the_manifest_says(tmp_path, node):
    scene = random_scene()
    write_scene_folder(tmp_path / "street", scene)
    manifest = json.loads((tmp_path / "street" / "scene.json").read_text())
    entry = manifest["instances"][-1]
    assert entry["node"] > 0
    entry.update(node=node, bounds=[[0, 0, 0], [1, 1, 1]])
    (tmp_path / "street" / "scene.json").write_text(json.dumps(manifest))
    assert list(read_scene_folder(tmp_path / "street").table) == list(scene.table)


def test_an_empty_static_scene(tmp_path):
    scene = scene_from_gaussians(random_scene(count=5).gaussians.select(slice(0, 0)))
    write_scene_folder(tmp_path, scene)
    assert_same_scene(read_scene_folder(tmp_path), scene)


def test_writing_is_deterministic_and_leaves_other_files_alone(tmp_path):
    (tmp_path / "checkpoint.safetensors").write_bytes(b"mine")
    write_scene_folder(tmp_path, random_scene())
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    write_scene_folder(tmp_path, random_scene())
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first
    write_scene_folder(tmp_path, random_scene(seed=1))
    assert len(list(tmp_path.iterdir())) == 3
    assert_same_scene(read_scene_folder(tmp_path), random_scene(seed=1))


def test_half_precision_is_small_and_keeps_positions_and_ids(tmp_path):
    scene = random_scene(count=3000)
    write_scene_folder(tmp_path / "full", scene)
    write_scene_folder(tmp_path / "half", scene, half=True)
    sizes = [sum(path.stat().st_size for path in (tmp_path / name).iterdir()) for name in ("full", "half")]
    assert sizes[1] < 0.62 * sizes[0]
    again = read_scene_folder(tmp_path / "half")
    assert again.gaussians.means.tobytes() == scene.gaussians.means.tobytes()
    np.testing.assert_array_equal(again.instance_ids, scene.instance_ids)
    for name, array in scene.gaussians.arrays().items():
        np.testing.assert_allclose(getattr(again.gaussians, name), array, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(again.sky.faces, scene.sky.faces, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(again.actors[0].world_from_box, scene.actors[0].world_from_box, rtol=1e-6, atol=1e-6)


def test_photos_move_with_the_folder(tmp_path):
    photo = tmp_path / "old" / "clip" / "00.jpg"
    view = dataclasses.replace(random_scene().views[0], photo=str(photo))
    without = dataclasses.replace(view, photo="")
    scene = dataclasses.replace(random_scene(), views=(view, without))
    write_scene_folder(tmp_path / "old" / "runs" / "a", scene)
    assert json.loads((tmp_path / "old/runs/a/scene.json").read_text())["views"][0]["photo"] == "../../clip/00.jpg"
    shutil.move(tmp_path / "old", tmp_path / "new")
    photos = [view.photo for view in read_scene_folder(tmp_path / "new" / "runs" / "a").views]
    assert photos == [str(tmp_path / "new" / "clip" / "00.jpg"), ""]


def test_a_save_that_fails_in_the_middle_keeps_the_old_scene(tmp_path, monkeypatch):
    write_scene_folder(tmp_path, random_scene())

    def full_disk(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(scene_folder, "write_bytes", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_scene_folder(tmp_path, random_scene(seed=1))
    assert_same_scene(read_scene_folder(tmp_path), random_scene())


def test_a_reader_beside_a_writer_always_finds_a_whole_scene(tmp_path):
    scenes = [random_scene(seed=seed, count=40) for seed in range(2)]
    write_scene_folder(tmp_path, scenes[0])
    stop = threading.Event()

    def keep_writing():
        while not stop.is_set():
            for scene in scenes:
                write_scene_folder(tmp_path, scene)

    writer = threading.Thread(target=keep_writing)
    writer.start()
    try:
        known = {scene.gaussians.means.tobytes() for scene in scenes}
        for _ in range(60):
            assert read_scene_folder(tmp_path).gaussians.means.tobytes() in known
    finally:
        stop.set()
        writer.join()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda manifest: manifest.update(format="other"), "format"),
        (lambda manifest: manifest.update(version=99), "99"),
        (lambda manifest: manifest.update(arrays="../../etc/passwd"), "arrays"),
        (lambda manifest: manifest.update(arrays="scene.0123456789abcdef.safetensors"), "damaged"),
        (lambda manifest: manifest.pop("instances"), "instances"),
        (lambda manifest: manifest["instances"].pop(0), "missing from 'instances'"),
        (lambda manifest: manifest["instances"][0].update(bounds=[1]), "damaged"),
        (lambda manifest: manifest["actors"][0].update(steps=9), "track_times"),
        (lambda manifest: manifest["actors"][0].update(steps=0), "no poses"),
        (lambda manifest: manifest["views"].pop(), "view_poses"),
        (lambda manifest: manifest["views"][0].update(width=0), "size 0"),
        (lambda manifest: manifest["views"][0]["lag"].update(turn=0), "has the lag"),
        (lambda manifest: manifest["views"][0]["lag"].update(start=[0, 1]), "has the lag"),
        (lambda manifest: manifest["views"][0]["lag"].pop("taken"), "taken"),
        (lambda manifest: manifest.update(views=[5] * 5), "damaged"),
        (lambda manifest: manifest.update(views=5), "damaged"),
        (lambda manifest: manifest.update(origin=[1, 2]), "origin"),
        (lambda manifest: manifest["exposures"].pop(), "exposure_times"),
        (lambda manifest: manifest["exposures"].append("front_camera/77"), "exposure_times"),
        (lambda manifest: manifest["exposures"].__setitem__(1, "front_camera/00"), "photo twice"),
        (lambda manifest: manifest["exposures"].__setitem__(1, 7), "'exposures'"),
        (lambda manifest: manifest.update(exposures="front"), "'exposures'"),
        (lambda manifest: manifest.update(code_bits=None), "damaged"),
        (lambda manifest: manifest.update(code_bits=1e400), "damaged"),
    ],
)
def test_damaged_manifests_are_explained(tmp_path, change, message):
    write_scene_folder(tmp_path, lagging_scene())
    manifest = json.loads((tmp_path / "scene.json").read_text())
    change(manifest)
    (tmp_path / "scene.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match=message):
        read_scene_folder(tmp_path)


@pytest.mark.parametrize(
    ("name", "damaged"),
    [
        ("exposure_matrices", None),
        ("exposure_times", None),
        ("exposure_matrices", np.zeros((4, 3, 3), np.float32)),
        ("exposure_matrices", np.zeros((4, 3, 4), np.int32)),
        ("exposure_matrices", np.full((4, 3, 4), np.nan, np.float32)),
    ],
)
def test_damaged_exposures_are_explained(tmp_path, monkeypatch, name, damaged):
    whole = scene_folder._collect_arrays

    def spoiled(scene: Scene) -> dict[str, np.ndarray]:
        arrays = whole(scene) | {name: damaged}
        return {key: array for key, array in arrays.items() if array is not None}

    monkeypatch.setattr(scene_folder, "_collect_arrays", spoiled)
    write_scene_folder(tmp_path, exposed_scene())
    with pytest.raises(DataError, match="not finite" if damaged is not None and np.isnan(damaged).any() else name):
        read_scene_folder(tmp_path)


def test_damaged_arrays_are_explained(tmp_path):
    write_scene_folder(tmp_path, random_scene())
    arrays = next(tmp_path.glob("scene.*.safetensors"))
    arrays.write_bytes(arrays.read_bytes()[:-100])
    with pytest.raises(DataError, match="damaged"):
        read_scene_folder(tmp_path)
    (tmp_path / "scene.json").write_bytes(b"{" * 100_000)
    with pytest.raises(DataError, match=r"scene\.json"):
        read_scene_folder(tmp_path)


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("", np.zeros(30, np.float32)),
        ("two words", np.zeros(30, np.float32)),
        ("a\nelement face 9", np.zeros(30, np.float32)),
        ("x", np.zeros(30, np.float32)),
        ("f_rest_3", np.zeros(30, np.float32)),
        ("instance_id", np.zeros(30, np.uint32)),
        ("ok", np.zeros(30, np.int64)),
        ("ok", np.zeros(30, bool)),
    ],
)
def test_columns_that_no_ply_could_hold_are_damage(tmp_path, name, column):
    scene = random_scene(count=30, actors=0)
    scene.extra = {name: column}
    write_scene_folder(tmp_path, scene)
    with pytest.raises(DataError, match="damaged"):
        read_scene_folder(tmp_path)


def test_a_scene_in_half_precision_can_be_saved_as_a_file(tmp_path):
    scene = random_scene(count=30, actors=0)
    write_scene_folder(tmp_path / "half", scene, half=True)
    save_scene(tmp_path / "a.ply", open_scene(tmp_path / "half"))
    kept = open_scene(tmp_path / "a.ply").extra
    assert set(kept) == set(scene.extra)
    for name, column in scene.extra.items():
        np.testing.assert_allclose(kept[name], column, rtol=1e-3, atol=1e-3)


SEEN = (
    SeenMover("front_camera", (Sighting(3, (0.1, 0.4, 0.25, 0.6)), Sighting(5, (0.0, 0.5, 1.0, 1.0))), "Car"),
    SeenMover("back_camera", (Sighting(0, (0.5, 0.5, 0.6, 0.7)),)),
)


def test_what_was_seen_moving_is_kept_and_older_scenes_have_none(tmp_path):
    write_scene_folder(tmp_path, dataclasses.replace(random_scene(), seen_movers=SEEN))
    assert read_scene_folder(tmp_path).seen_movers == SEEN
    manifest = json.loads((tmp_path / "scene.json").read_text())
    del manifest["seen_moving"]
    (tmp_path / "scene.json").write_text(json.dumps(manifest))
    assert read_scene_folder(tmp_path).seen_movers == ()


@pytest.mark.parametrize(
    ("sightings", "problem"),
    [([], "no sightings"), ([{"step": 1, "box": [0.5, 0.1, 0.4, 0.2]}], "not a part of a photo")],
)
def test_a_mover_seen_nowhere_is_damage(tmp_path, sightings, problem):
    write_scene_folder(tmp_path, random_scene())
    manifest = json.loads((tmp_path / "scene.json").read_text())
    manifest["seen_moving"] = [{"camera": "front_camera", "label": "", "sightings": sightings}]
    (tmp_path / "scene.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match=problem):
        read_scene_folder(tmp_path)
