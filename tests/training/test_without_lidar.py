"""Clips of photos alone train: from sparse points or random ones, static, without masks, and it says so."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from moving_photos import Board, make_clip, standing_board, write_as_nerfstudio, write_street_masks
from photo_models import photo_model, write_colmap_binary, write_nerfstudio
from small_clip import write_small_clip

from instdrive_core.cli.info import print_info
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.formats.checkpoints.sample_files import build_gsplat_content, write_checkpoint
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.build_trainer import build_trainer_from_scene
from instdrive_core.training.gaussians.first_gaussians import build_initial_scene
from instdrive_core.training.gaussians.points_without_lidar import gather_points_without_lidar
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, build_train_config
from instdrive_core.training.settings.events import StepDone
from instdrive_core.training.views.photo_depth import estimate_missing_depths
from instdrive_core.training.views.view_store import open_view_store

INIT = InitConfig(lidar_points=400, near_points=100, far_points=100)


@pytest.fixture(scope="module")
def model():
    return photo_model()


def run(clip, out, iterations=12):
    config = build_train_config("instdrive", "demo", seed=1)
    geometry = replace(config.geometry, iterations=iterations, coarse_iterations=4, sky_resolution=8)
    notes, losses = [], []
    run_training(
        RunRequest(clip, out, ClipOptions(), replace(config, init=INIT, geometry=geometry)),
        lambda event: losses.append(event) if isinstance(event, StepDone) else None,
        notes.append,
    )
    return " | ".join(notes), losses


def test_a_colmap_model_trains_rgb_only_and_says_so(model, tmp_path):
    notes, steps = run(write_colmap_binary(tmp_path / "clip", model), tmp_path / "run", iterations=100)
    assert steps[-1].psnr > steps[0].psnr + 5
    for note in ("scale is unknown", "starting from 40 sparse points", "no cuboids", "no masks: training RGB only"):
        assert note in notes
    scene, facts = read_scene_folder(tmp_path / "run"), json.loads((tmp_path / "run" / "run.json").read_text())
    assert facts["masks"] is None
    assert len(scene) == facts["n_gaussians"] > 0
    assert len(scene.table) == 0
    assert [view.held_out for view in scene.views] == [False] * 4 + [True]


def test_without_points_training_starts_from_random_ones(model, tmp_path):
    root = write_nerfstudio(tmp_path / "clip", model)
    content = json.loads((root / "transforms.json").read_text())
    del content["ply_file_path"]
    (root / "transforms.json").write_text(json.dumps(content))
    clip = load_clip(str(root), ClipOptions())
    with open_view_store(clip, None) as store:
        start = build_initial_scene(clip, store, INIT, 0, seed=1)
        again = build_initial_scene(clip, store, INIT, 0, seed=1)
        depths = np.concatenate([facts.camera.project(start.gaussians.means)[1] for facts in store.facts])
    assert len(start.gaussians) == 600
    assert np.isfinite(start.gaussians.means).all()
    assert depths.max() > 20
    np.testing.assert_array_equal(start.gaussians.means, again.gaussians.means)
    notes, _ = run(root, tmp_path / "run")
    assert "no LiDAR and no points: starting from what photos agree on" in notes


def test_a_recorded_drive_whose_sweeps_are_missing_starts_from_random_points(tmp_path):
    root = write_small_clip(tmp_path / "clip")
    shutil.rmtree(root / "lidar")
    notes, steps = run(root, tmp_path / "run")
    assert "no LiDAR and no points: starting from what photos agree on" in notes
    assert "no masks: training RGB only" in notes
    assert len(steps) > 0
    assert len(read_scene_folder(tmp_path / "run")) > 0


def test_where_photos_agree_training_starts(tmp_path):
    boards = (standing_board(3.0, 22),)
    clip = make_clip(boards, 8)
    depths = estimate_missing_depths(clip, lambda note: None)
    with open_view_store(clip, None, photo_depths=depths) as store:
        points = gather_points_without_lidar(clip, store, INIT, seed=1)
    assert len(points.lidar) > 2000
    x, _, z = np.abs(points.lidar.positions - clip.origin).T
    on_ground, on_wall = z < 0.15, np.abs(x - 6) < 0.3
    assert (on_ground | on_wall).mean() > 0.8
    notes, steps = run(write_as_nerfstudio(tmp_path / "street", boards, 8), tmp_path / "run")
    assert "photos agree on how far off" in notes
    assert "depth" in steps[-1].terms


def test_sparse_points_are_taken_with_their_colours(model, tmp_path):
    clip = load_clip(str(write_colmap_binary(tmp_path / "clip", model)), ClipOptions())
    with open_view_store(clip, None) as store:
        points = gather_points_without_lidar(clip, store, INIT, seed=1)
    assert len(points.lidar) == 40
    np.testing.assert_allclose(points.lidar.colors, model.colors / 255, atol=1e-6)
    assert len(points.near) > 0
    assert len(points.far) > 0


def test_points_that_no_photo_sees_are_an_error(model, tmp_path):
    clip = load_clip(str(write_colmap_binary(tmp_path / "clip", model)), ClipOptions())
    above = replace(clip.points, points=clip.points.points + np.float32([0, 0, 500]))
    with (
        open_view_store(clip, None) as store,
        pytest.raises(DataError, match="no training photo sees one of its 40 points"),
    ):
        build_initial_scene(replace(clip, points=above), store, INIT, 0, seed=1)


def test_what_moves_is_kept_out_and_the_scene_remembers_it(tmp_path, capsys):
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    boards = (standing_board(4.5, 24), Board(lambda time: (1.8, 8 + 8 * time)))
    root = write_as_nerfstudio(tmp_path / "street", boards, 8)
    clip = make_clip(boards, 8)
    write_street_masks(root / "masks", rename_frames(clip), boards)
    notes, _ = run(root, tmp_path / "run")
    assert "1 thing seen moving, not rebuilt" in notes
    assert json.loads((tmp_path / "run" / "run.json").read_text())["seen_moving"] == 1
    (mover,) = read_scene_folder(tmp_path / "run").seen_movers
    assert [sighting.step for sighting in mover.sightings] == [0, 1, 2, 3, 5, 6, 7]
    print_info(tmp_path / "run")
    assert "1 thing, not rebuilt (camera)" in capsys.readouterr().out


def rename_frames(clip):
    """The clip with the camera's name that nerfstudio's folder gives it."""
    frames = (replace(frame, view=replace(frame.view, name="camera")) for frame in clip.frames)
    return replace(clip, frames=tuple(frames))


def test_a_checkpoint_of_another_trainer_is_moved_to_where_the_clip_is(model, tmp_path):
    clip = load_clip(str(write_colmap_binary(tmp_path / "clip", model)), ClipOptions(scale=1.0))
    content = build_gsplat_content(np.random.default_rng(2), len(model.points))
    content["splats"]["means"] = model.listed_points().astype(np.float32)
    path = write_checkpoint(tmp_path / "ckpt_6999_rank0.pt", content)
    with open_view_store(clip, None) as store:
        config = build_train_config("instdrive", "demo", seed=1)
        trainer = build_trainer_from_scene(config, clip, store, path, CpuBackend())
    np.testing.assert_allclose(trainer.model.gaussians().means, clip.points.points, atol=1e-4)
    assert np.abs(clip.points.points - model.listed_points()).max() > 0.5  # the clip is upright, the file is not
