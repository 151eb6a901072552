"""Optical flow against points that are followed, and confidence against what photos saw."""

import dataclasses
import json

import numpy as np
import pytest
from PIL import Image
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.edits.document.document import Document
from instdrive_core.formats.registry import save_scene
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.recording.confidence import count_seeing_photos, draw_confidence, summarize_confidence
from instdrive_core.recording.drive import take_drive
from instdrive_core.recording.ego_path import EgoChange
from instdrive_core.recording.flow import compute_flow
from instdrive_core.recording.plan import RecordOptions
from instdrive_core.recording.record import record_drive
from instdrive_core.recording.report import REPORT
from instdrive_core.scene.camera import look_at
from instdrive_core.scene.scene import place_in_world


@pytest.fixture(scope="module")
def scene():
    scene = random_scene(count=300)
    scene.gaussians.log_scales[:] = -1.2
    scene.gaussians.opacity_logits[:] = 3
    return scene


def test_flow_follows_surfaces_and_actors(scene):
    view, following = scene.views[1], scene.views[2]
    shown = view_scene(scene, view.camera, view.time)
    depth = np.where(shown.alpha >= 0.5, shown.depth, np.float32(0))
    found = compute_flow(scene, view, following, depth, shown.winner)
    rows, columns = np.nonzero((depth > 0) & found.valid)
    assert len(rows) > 100
    assert (scene.nodes[shown.winner[rows, columns]] > 0).any(), "no actor is looked at"
    for y, x in list(zip(rows, columns, strict=True))[::37]:
        # The surface in its node's frame, which stays, then where the next camera has it.
        camera = view.camera
        local = np.array([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1]) * depth[y, x]
        world = camera.world_from_camera[:3, :3] @ local + camera.position
        node = int(scene.nodes[shown.winner[y, x]])
        early, late = (scene.find_node_poses(time)[0][node] for time in (view.time, following.time))
        kept = np.linalg.inv(early) @ [*world, 1.0]
        pixels, _ = following.camera.project((late @ kept)[None, :3])
        np.testing.assert_allclose(found.flow[y, x], pixels[0] - [x + 0.5, y + 0.5], atol=1e-2)


def test_the_sky_moves_with_turns_only(scene):
    view = scene.views[0]
    nothing = np.zeros((48, 64), np.float32)
    shifted = view.camera.world_from_camera.copy()
    shifted[:3, 3] += 5
    moved = dataclasses.replace(view, camera=dataclasses.replace(view.camera, world_from_camera=shifted))
    found = compute_flow(scene, view, moved, nothing, np.full((48, 64), -1, np.int32))
    np.testing.assert_allclose(found.flow, 0, atol=1e-4)


def test_surfaces_behind_the_next_camera_have_no_flow(scene):
    view = scene.views[0]
    turned = view.camera.world_from_camera.copy()
    turned[:3, :3] = turned[:3, :3] @ np.diag([-1.0, 1.0, -1.0])
    away = dataclasses.replace(view, camera=dataclasses.replace(view.camera, world_from_camera=turned))
    found = compute_flow(scene, view, away, np.full((48, 64), 3, np.float32), np.full((48, 64), -1, np.int32))
    assert not found.valid.any()
    assert not found.flow.any()


def test_photos_are_counted_that_see_a_splat(scene):
    counts = count_seeing_photos(scene, scene.views)
    assert counts.max() == len(scene.views)
    view = scene.views[0]
    away = look_at(view.camera.position, 2 * view.camera.position)
    blind = dataclasses.replace(view, camera=dataclasses.replace(view.camera, world_from_camera=away))
    poses, _ = scene.find_node_poses(view.time)
    means, _ = place_in_world(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
    behind = blind.camera.project(means)[1] < -1
    assert not count_seeing_photos(scene, [blind])[behind].any()


def test_confidence_is_the_share_of_trusted_weight(scene):
    view = scene.views[0]
    covered = view_scene(scene, view.camera, view.time).alpha >= 0.5
    every, none = np.ones(len(scene), bool), np.zeros(len(scene), bool)
    np.testing.assert_allclose(draw_confidence(scene, view, every)[covered], 1, atol=1e-4)
    assert not draw_confidence(scene, view, none).any()
    half = np.arange(len(scene)) % 2 == 0
    found = summarize_confidence(draw_confidence(scene, view, half), covered)
    assert 0.2 < found.mean < 0.8
    assert summarize_confidence(np.ones((2, 2), np.float32), np.zeros((2, 2), bool)).mean == 0


def test_another_way_is_recorded_with_confidence_and_a_report(scene, tmp_path):
    drive = take_drive(Document(scene), RecordOptions(first=0, last=2, flow=True, ego=(EgoChange("shift", 1.0),)))
    manifest = record_drive(tmp_path / "out", drive)
    assert 0 < manifest["confidence"]["mean"] <= 1
    assert set(manifest["confidence"]["by_camera"]) == {"front_camera"}
    assert "## Confidence" in (tmp_path / "out" / REPORT).read_text()
    listing = json.loads((tmp_path / "out/views/front_camera/01.json").read_text())
    assert listing["confidence"]["mean"] > 0
    own = np.array(scene.views[1].camera.world_from_camera)[:3, 3]
    assert np.linalg.norm(np.array(listing["world_from_camera"])[:3, 3] - own) == pytest.approx(1.0)
    with Image.open(tmp_path / "out/confidence/front_camera/01.png") as picture:
        assert np.asarray(picture).dtype == np.uint8
    flows = sorted(path.name for path in (tmp_path / "out/flow/front_camera").iterdir())
    assert flows == ["00.npz", "01.npz"], "the last moment has no next one"
    stored = np.load(tmp_path / "out/flow/front_camera/00.npz")
    assert stored["flow"].shape == (48, 64, 2)


def test_the_command_takes_ways_and_names_bad_ones(scene, tmp_path, capsys):
    save_scene(tmp_path / "run", scene)
    asked = ["simulate", str(tmp_path / "run"), "-o", str(tmp_path / "out"), "--last", "1"]
    assert main([*asked, "--shift", "0.5"]) == 0
    assert "At least two photos saw" in capsys.readouterr().out
    assert main([*asked, "--ego", "fly=3"]) == 2
    assert "'fly=3' is no change of the way" in capsys.readouterr().err
