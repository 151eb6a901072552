"""Runs follow their clip: usual ones stay as they are, longer ones get more, within bounds."""

from dataclasses import replace

import numpy as np
import pytest
from post_street import PostStreet

from instdrive_core.datasets.clip import Clip, SparsePoints, is_held_out
from instdrive_core.training.settings.clip_size import (
    MOST_GROWTH,
    MOST_STRETCH,
    USUAL_PHOTOS,
    AskedSizes,
    compute_stretch,
    fit_to_clip,
    measure_way,
)
from instdrive_core.training.settings.config import build_train_config

TWO = PostStreet().build_clip()


def drive(steps: int, cameras: int = 6, speed: float = 7.0, width: int = 480) -> Clip:
    """A clip of so many photos on a straight way."""
    names = tuple(f"camera{number}" for number in range(cameras))
    frames = []
    for step in range(steps):
        pose = np.eye(4)
        pose[1, 3] = 0.1 * speed * step
        camera = replace(TWO.frames[0].view.camera, width=width, height=width * 9 // 16, world_from_camera=pose)
        for name in names:
            view = replace(TWO.frames[0].view, camera=camera, name=name, index=step, held_out=is_held_out(step))
            frames.append(replace(TWO.frames[0], view=view))
    return replace(TWO, frames=tuple(frames), camera_names=names)


@pytest.mark.parametrize("clip", [drive(20), drive(30), drive(3, cameras=1)])
def test_clips_up_to_the_usual_size_train_as_before(clip: Clip) -> None:
    config = build_train_config()
    assert fit_to_clip(config, clip) == config


def test_a_longer_drive_shows_each_photo_as_often_and_has_room_for_its_street() -> None:
    usual, clip = build_train_config(), drive(80)
    config = fit_to_clip(usual, clip)
    assert len(clip.training_frames) == 432
    per_photo = config.geometry.iterations / len(clip.training_frames)
    assert per_photo == pytest.approx(usual.geometry.iterations / USUAL_PHOTOS, rel=1e-3)
    assert config.geometry.coarse_iterations / config.geometry.iterations == pytest.approx(1 / 9, rel=1e-3)
    assert config.densify.every == pytest.approx(usual.densify.every * 432 / 162, abs=0.5)
    assert measure_way(clip) == pytest.approx(55.3)
    assert config.densify.max_gaussians == pytest.approx(300_000 * (55.3 + 40) / 61, rel=1e-3)
    assert config.init.lidar_points == pytest.approx(150_000 * (55.3 + 40) / 61, rel=1e-3)
    assert config.init.far_points == usual.init.far_points
    slow = fit_to_clip(usual, drive(80, speed=1.0))
    assert slow.densify.max_gaussians == 300_000, "a car that creeps sees no more street"
    assert slow.geometry.iterations == config.geometry.iterations


def test_larger_photos_get_more_gaussians_as_far_as_memory_goes() -> None:
    usual = build_train_config()
    assert fit_to_clip(usual, drive(20, width=960)).densify.max_gaussians == 600_000
    assert fit_to_clip(usual, drive(20, width=320)).densify.max_gaussians == 300_000
    huge = fit_to_clip(usual, drive(300, width=960))
    assert huge.densify.max_gaussians == MOST_GROWTH * 300_000
    assert huge.geometry.iterations == MOST_STRETCH * 4_500
    assert compute_stretch(10**6) == MOST_STRETCH


def test_clips_in_an_unknown_unit_are_not_measured_in_metres() -> None:
    clip = replace(drive(80), points=SparsePoints.none())
    assert fit_to_clip(build_train_config(), clip).densify.max_gaussians == 300_000


@pytest.mark.parametrize("preset", ["demo", "paper"])
def test_presets_of_a_fixed_length_keep_it(preset: str) -> None:
    config = build_train_config(preset=preset)
    assert fit_to_clip(config, drive(80)) == config


def test_what_a_user_asks_for_wins() -> None:
    config = fit_to_clip(build_train_config(), drive(80), AskedSizes(iterations=1_000, max_gaussians=150_000))
    assert config.geometry.iterations == 1_000
    assert config.densify.max_gaussians == 150_000
    assert fit_to_clip(build_train_config(preset="paper"), drive(80), AskedSizes(600)).geometry.iterations == 600
