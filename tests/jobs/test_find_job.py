"""Objects of a bare scene are found in photos and masks, by a job that can be stopped, and wrong input is named."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from photographed_street import write_photographed_street
from PIL import Image

from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.errors import DataError, OptionError
from instdrive_core.finding.known_photos import find_known_photos
from instdrive_core.finding.seen_objects import read_seen_objects
from instdrive_core.jobs.find_source import look_at_photos
from instdrive_core.jobs.job_file import JobRequest, ask_job, locate_project
from instdrive_core.jobs.run_job import run_job
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.project.open import open_document, open_project
from instdrive_core.project.save import save_project


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    return write_photographed_street(tmp_path_factory.mktemp("street"))


@pytest.fixture(scope="module")
def found(street, tmp_path_factory):
    """Found on a project that turns the scene and deletes some of it."""
    document, _ = open_document(street.scene)
    document.apply(TurnScene.make_upright((0.0, -1.0, 0.0)))
    document.apply(DeleteRows(np.flatnonzero(street.ids == 12)))
    project = tmp_path_factory.mktemp("project") / "street.instdrive"
    save_project(project, document)
    run = tmp_path_factory.mktemp("found") / "objects"
    state = run_job(run, request(project, street.photos))
    assert state.status == "done"
    assert [stage.name for stage in state.stages] == ["take", "learn", "keep"]
    return run


def request(source, photos, **values):
    return JobRequest(str(source), kind="find-objects", clip=str(photos), **values)


def test_cars_are_objects_of_their_own(street, found):
    numbers = read_seen_objects(found).numbers
    assert len(numbers) == len(street.ids)
    for car in (10, 11, 12, 13):
        rows = street.ids == car
        most = np.bincount(numbers[rows]).argmax()
        same = numbers == most
        assert np.count_nonzero(rows & same) > 0.5 * np.count_nonzero(rows | same), car


def test_the_project_has_them_as_one_edit_and_deleted_splats_stay(street, found):
    document = open_project(locate_project(found)).document
    titles = [edit.title for edit in document.history.edits]
    assert titles[-1] == "Find objects"
    assert len(titles) == 3
    ids = document.scene.instance_ids
    assert not ids[street.ids == 12].any()
    assert (ids[street.ids != 12] > 0).all()
    assert len(document.scene.table) > 8
    document.undo()
    assert not document.scene.instance_ids.any()


def test_a_stopped_job_goes_on_and_finds_the_same(street, found, tmp_path):
    def stop(state):
        if state.stage is not None and state.stage.name == "learn":
            ask_job(tmp_path / "objects", "stop")

    assert run_job(tmp_path / "objects", request(street.scene, street.photos), stop).status == "stopped"
    assert run_job(tmp_path / "objects", request(street.scene, street.photos)).status == "done"
    again, before = read_seen_objects(tmp_path / "objects"), read_seen_objects(found)
    np.testing.assert_array_equal(again.numbers, before.numbers)


def test_label_maps_made_elsewhere_are_taken(street, tmp_path):
    maps = tmp_path / "maps"
    for file in (street.photos / "masks").rglob("*.png"):
        if "sky" not in file.parts:
            (maps / file.parent.name).mkdir(parents=True, exist_ok=True)
            shutil.copy(file, maps / file.parent.name / file.name)
    state = run_job(tmp_path / "objects", request(street.scene, street.photos, masks=str(maps)))
    assert state.status == "done"
    assert [stage.name for stage in state.stages] == ["take", "masks", "learn", "keep"]
    assert len(read_seen_objects(tmp_path / "objects").classes) > 8


def test_poses_of_a_trainers_folder_are_enough(street, tmp_path):
    """A model of the INRIA trainer: its cameras.json and the photos, no data set; masks lie beside the photos."""
    model, listed = tmp_path / "model", json.loads((street.photos / "transforms.json").read_text())
    ply = model / "point_cloud" / "iteration_7000" / "point_cloud.ply"
    ply.parent.mkdir(parents=True)
    shutil.copy(street.scene, ply)
    shutil.copytree(street.photos / "images", model / "images")
    shutil.copytree(street.photos / "masks", model / "images" / "masks")
    cameras = []
    for frame in listed["frames"]:
        pose = np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])
        size = {"width": listed["w"], "height": listed["h"], "fx": listed["fl_x"], "fy": listed["fl_y"]}
        turn, place = pose[:3, :3].tolist(), pose[:3, 3].tolist()
        cameras.append({"img_name": Path(frame["file_path"]).stem, "rotation": turn, "position": place, **size})
    (model / "cameras.json").write_text(json.dumps(cameras))
    assert find_known_photos(ply) == model / "images"
    found = look_at_photos(ply, model / "images")
    assert (found.title, found.mask_plans[0], found.problem) == ("3DGS clip", "own", "")
    assert run_job(tmp_path / "objects", request(ply, "")).status == "done"
    assert len(read_seen_objects(tmp_path / "objects").classes) > 8
    with pytest.raises(DataError, match="no photos with poses"):
        look_at_photos(street.scene, model / "images")


def test_cameras_beside_the_scene_lead_to_photos_in_another_world(street, tmp_path):
    """The photos were posed again, askew and in another unit; their names tell which camera is which."""
    beside = shutil.copytree(street.photos, tmp_path / "export", ignore=shutil.ignore_patterns("masks"))
    scene = shutil.copy(street.scene, beside / "street.ply")
    other = shutil.copytree(street.photos, tmp_path / "again")
    listed = json.loads((other / "transforms.json").read_text())
    turn = matrix_from_quaternion(np.array([0.5, 0.1, 0.7, -0.5]))
    for frame in listed["frames"]:
        pose = np.array(frame["transform_matrix"])
        pose[:3, :3], pose[:3, 3] = turn @ pose[:3, :3], 2.5 * turn @ pose[:3, 3] + np.array([3.0, -1.0, 2.0])
        frame["transform_matrix"] = pose.tolist()
    (other / "transforms.json").write_text(json.dumps(listed))
    assert run_job(tmp_path / "objects", request(scene, other)).status == "done"
    (beside / "transforms.json").unlink()
    with pytest.raises(DataError, match=r"its photos do not show|hardly any of the scene"):
        run_job(tmp_path / "out", request(scene, other))


def test_photos_of_another_scene_are_told_apart(street, tmp_path):
    other = shutil.copytree(street.photos, tmp_path / "other")
    for file in (other / "images").iterdir():
        with Image.open(file) as photo:
            mirrored = np.asarray(photo)[::-1, ::-1]
        Image.fromarray(mirrored).save(file)
    with pytest.raises(DataError, match="its photos do not show the scene"):
        run_job(tmp_path / "out", request(street.scene, other))


def test_wrong_input_is_refused_before_anything_is_written(street, tmp_path):
    bare = tmp_path / "bare" / "photos"
    shutil.copytree(street.photos, bare, ignore=shutil.ignore_patterns("masks"))
    (tmp_path / "empty").mkdir()
    lonely = shutil.copy(street.scene, tmp_path / "lonely.ply")
    for asked, error, words in (
        (request(lonely, ""), OptionError, "nothing tells which photos show it"),
        (request(street.scene, tmp_path / "empty"), DataError, "no photos with poses"),
        (request(street.scene, tmp_path / "gone"), DataError, "no such folder"),
        (request(tmp_path / "gone.ply", street.photos), DataError, "no such scene"),
        (request(street.scene, bare, masks=str(tmp_path / "gone")), DataError, "label map for each photo"),
    ):
        with pytest.raises(error, match=words):
            run_job(tmp_path / "out", asked)
    assert not (tmp_path / "out").exists()


def test_without_masks_the_remedy_is_named(street, tmp_path, monkeypatch):
    bare = shutil.copytree(street.photos, tmp_path / "photos", ignore=shutil.ignore_patterns("masks"))
    monkeypatch.setattr("instdrive_core.jobs.source.choose_photo_masks", lambda: "none")
    with pytest.raises(OptionError, match=r"pip install 'instdrive\[sam\]'"):
        run_job(tmp_path / "out", request(street.scene, bare))
