"""Cameras of other programs beside a scene: INRIA's, nerfstudio's and COLMAP's give views, photos and up."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from procedural_street import procedural_street

from instdrive_app.session.files.opening import open_for_editing
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.edits.queries.scene_up import estimate_document_up
from instdrive_core.formats.registry import save_scene
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.project.open import open_document
from instdrive_core.project.save import save_project
from instdrive_core.project.sources import has_cameras_beside
from instdrive_core.scene.camera import look_at
from instdrive_core.scene.scene import scene_from_gaussians

EYES = [np.array([x, -8.0, 3.0]) for x in (-2.0, 0.0, 2.0)]
POSES = [look_at(eye, np.array([0.0, 4.0, 1.0])) for eye in EYES]


@pytest.fixture
def scene(tmp_path):
    """A .ply as other programs write it, in a folder of its own."""
    path = tmp_path / "model/point_cloud/iteration_7000/point_cloud.ply"
    path.parent.mkdir(parents=True)
    save_scene(path, scene_from_gaussians(procedural_street().gaussians.select(slice(None))), sibr=True)
    return path


def write_inria(folder, poses=POSES, change=lambda entry: entry):
    entries = [
        {"id": number, "img_name": f"{number:03d}", "width": 160, "height": 90, "fx": 130.0, "fy": 130.0}
        | {"position": pose[:3, 3].tolist(), "rotation": pose[:3, :3].tolist()}
        for number, pose in enumerate(poses)
    ]
    (folder / "cameras.json").write_text(json.dumps([change(entry) for entry in entries]))


def write_nerfstudio(folder):
    frames = [
        {"file_path": f"images/{number:03d}.png", "transform_matrix": (pose @ np.diag([1.0, -1, -1, 1])).tolist()}
        for number, pose in enumerate(POSES)
    ]
    lens = {"w": 160, "h": 90, "fl_x": 130.0, "fl_y": 130.0, "cx": 80.0, "cy": 45.0}
    (folder / "transforms.json").write_text(json.dumps(lens | {"frames": frames}))


def write_colmap(folder):
    (folder / "sparse/0").mkdir(parents=True)
    (folder / "sparse/0/cameras.txt").write_text("1 PINHOLE 160 90 130 130 80 45\n")
    lines = []
    for number, pose in enumerate(POSES):
        inverse = np.linalg.inv(pose)
        values = (*quaternion_from_matrix(inverse[:3, :3]), *inverse[:3, 3])
        lines += [f"{number + 1} {' '.join(map(str, values))} 1 {number:03d}.png", ""]
    (folder / "sparse/0/images.txt").write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("write", [write_inria, write_nerfstudio, write_colmap])
def test_views_and_photos_come_from_what_lies_beside(scene, write):
    folder = scene.parent.parent.parent
    write(folder)
    (folder / "images").mkdir()
    Image.new("RGB", (160, 90)).save(folder / "images/001.png")
    opened = open_for_editing(scene)
    views = opened.document.scene.views
    assert np.allclose([view.camera.position for view in views], EYES)
    assert [bool(view.photo) for view in views] == [False, True, False]
    assert views[1].photo == str(folder / "images/001.png")
    assert any("3 cameras from" in note and "1 of them" in note for note in opened.notes)
    assert has_cameras_beside(opened.document)


def test_the_cameras_say_what_is_up(scene):
    turn = np.eye(4)
    turn[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    gaussians = procedural_street().gaussians
    lying = replace(gaussians, means=(gaussians.means @ turn[:3, :3].T.astype(np.float32)))
    save_scene(scene, scene_from_gaussians(lying), sibr=True)
    write_inria(scene.parent, [turn @ pose for pose in POSES])
    estimate = estimate_document_up(open_for_editing(scene).document)
    assert estimate.confident
    assert estimate.direction @ [0, 1, 0] == pytest.approx(1, abs=0.05)


def test_a_project_turns_them_again(scene, tmp_path):
    write_inria(scene.parent)
    document, _ = open_document(scene)
    document.apply(TurnScene((0.5**0.5, 0.0, 0.0, 0.5**0.5)))
    save_project(tmp_path / "turned.instdrive", document)
    again, _ = open_document(tmp_path / "turned.instdrive")
    for one, other in zip(document.scene.views, again.scene.views, strict=True):
        assert np.allclose(one.camera.world_from_camera, other.camera.world_from_camera)
    again.undo()
    assert np.allclose(again.scene.views[0].camera.position, EYES[0])


@pytest.mark.parametrize(
    "change",
    [
        lambda entry: entry | {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 5]]},
        lambda entry: entry | {"position": [0, 0]},
        lambda entry: entry | {"fx": "wide"},
        lambda entry: entry | {"img_name": "../../secret"},
        lambda entry: entry | {"width": 0},
        lambda entry: 3,
    ],
)
def test_damaged_cameras_are_told_of_and_left_out(scene, change):
    write_inria(scene.parent, change=change)
    opened = open_for_editing(scene)
    assert opened.document.scene.views == ()
    assert any("left out" in note and "cameras.json" in note for note in opened.notes)


def test_cameras_of_another_scene_are_left_out(scene):
    write_inria(scene.parent, [look_at(np.array([500.0, 0, 2]), np.array([600.0, 0, 2]))] * 3)
    opened = open_for_editing(scene)
    assert opened.document.scene.views == ()
    assert any("do not look at this scene" in note for note in opened.notes)


def test_scenes_that_have_instances_keep_to_themselves(tmp_path):
    save_scene(tmp_path / "own.ply", freeze_at_time(procedural_street(), 0.0))
    write_inria(tmp_path)
    assert not has_cameras_beside(open_document(tmp_path / "own.ply")[0])
