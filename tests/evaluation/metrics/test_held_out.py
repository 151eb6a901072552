"""Images of held-out views: exposed as their neighbours in training, and measured in the boxes that the clip knows."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation_scene import DRIVING, ToyDrive

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.evaluation.metrics.box_pixels import find_moving_box_pixels
from instdrive_core.evaluation.metrics.held_out import HeldOutView, measure_held_out_view
from instdrive_core.evaluation.metrics.image_metrics import psnr
from instdrive_core.evaluation.protocol import evaluate_scene
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.exposure import Exposures, apply_exposure
from instdrive_core.scene.scene import Scene


def seen(drive: ToyDrive, scene: Scene, frame: Frame, clip: Clip | None = None) -> HeldOutView:
    return measure_held_out_view(scene, clip or drive.clip, frame, drive.truth)


def held_out(drive: ToyDrive, index: int = 4) -> Frame:
    return next(frame for frame in drive.clip.held_out_frames if frame.view.index == index)


def repainted(frame: Frame, change) -> Frame:
    """The frame with `change` done to its photo as floats in [0, 1]."""
    photo = change(frame.load_image().astype(np.float32) / 255)
    return replace(frame, load_image=lambda: np.round(np.clip(photo, 0, 1) * 255).astype(np.uint8))


def darkening(time: float) -> np.ndarray:
    """An exposure that falls with time, linearly; red falls faster and leaks into green."""
    matrix = np.eye(3, 4, dtype=np.float32) * np.float32(1 - 0.3 * time)
    matrix[0, 0] -= 0.2 * time
    matrix[1, 0], matrix[:, 3] = 0.1 * time, 0.05 * time
    return matrix


def exposures_of_training(drive: ToyDrive) -> Exposures:
    frames = drive.clip.training_frames
    times = np.array([frame.view.time for frame in frames])
    return Exposures(tuple(frame.key for frame in frames), times, np.stack([darkening(time) for time in times]))


def test_a_held_out_photo_is_exposed_between_its_cameras_neighbours(drive):
    frame = held_out(drive)
    exposures = exposures_of_training(drive)
    assert frame.key not in exposures.keys
    scene = replace(drive.scene, exposures=exposures)
    darkened = repainted(frame, lambda photo: apply_exposure(photo, darkening(frame.view.time)))
    plain, with_exposures = seen(drive, drive.scene, darkened), seen(drive, scene, darkened)
    assert with_exposures.psnr > plain.psnr + 1
    assert with_exposures.ssim > plain.ssim
    assert with_exposures.psnr_actors > plain.psnr_actors + 0.5
    image = view_scene(drive.scene, frame.view.camera, frame.view.time).color
    image = np.clip(apply_exposure(image, darkening(frame.view.time)), 0, 1)
    expected = psnr(image, darkened.load_image().astype(np.float32) / 255, frame.valid)
    assert with_exposures.psnr == pytest.approx(expected, abs=1e-3)


def test_exposures_change_no_map(drive):
    frame = held_out(drive)
    plain = seen(drive, drive.scene, frame)
    changed = seen(drive, replace(drive.scene, exposures=exposures_of_training(drive)), frame)
    np.testing.assert_array_equal(plain.winner, changed.winner)
    np.testing.assert_array_equal(plain.codewords, changed.codewords)
    assert changed.psnr < plain.psnr


def without_actors(scene: Scene) -> Scene:
    """What a run that knows no moving objects might leave: the driving car's Gaussians are gone."""
    kept = np.flatnonzero(scene.nodes == 0)
    return replace(
        scene,
        gaussians=scene.gaussians.select(kept),
        instance_ids=scene.instance_ids[kept],
        codewords=scene.codewords[kept],
        nodes=scene.nodes[kept],
        actors=(),
    )


def test_actors_are_measured_in_the_clips_boxes_only_whatever_the_scene_holds(drive):
    frame, static = held_out(drive), without_actors(drive.scene)
    boxes = find_moving_box_pixels(frame.view.camera, drive.clip.tracks, frame.view.time)
    assert boxes.any()
    assert not boxes[drive.truth.load(frame) == 2].any(), "the parked car is beside"
    outside = repainted(frame, lambda photo: np.where(boxes[..., None], photo, 1 - photo))
    inside = repainted(frame, lambda photo: np.where(boxes[..., None], 1 - photo, photo))
    for scene in (drive.scene, static):
        plain = seen(drive, scene, frame)
        assert seen(drive, scene, outside).psnr_actors == plain.psnr_actors
        assert seen(drive, scene, inside).psnr_actors != plain.psnr_actors
    assert seen(drive, static, frame).psnr_actors < seen(drive, drive.scene, frame).psnr_actors - 2
    assert (drive.truth.load(frame)[boxes] == DRIVING).mean() > 0.8


FACTS = dict.fromkeys(
    ("train_seconds", "peak_rss_mb", "iterations", "seed", "clip", "cameras", "masks", "backend"), None
)


def test_views_without_moving_objects_count_for_nothing_not_for_zero(drive):
    gone = replace(drive.clip.tracks[1], times=drive.clip.tracks[1].times - 1.0)
    clip = replace(drive.clip, tracks=(drive.clip.tracks[0], gone))  # the track now ends before the last step
    early, late = seen(drive, drive.scene, held_out(drive), clip), seen(drive, drive.scene, held_out(drive, 14), clip)
    assert early.psnr_actors is not None
    assert late.psnr_actors is None
    figures = evaluate_scene(drive.scene, clip, drive.truth, FACTS).figures
    views = [seen(drive, drive.scene, frame, clip) for frame in clip.held_out_frames]
    known = [view.psnr_actors for view in views if view.psnr_actors is not None]
    assert len(known) == 2, "both cameras of step 4"
    assert figures["psnr_actors"] == pytest.approx(np.mean(known))
    nobody = replace(drive.clip, tracks=drive.clip.tracks[:1])
    assert evaluate_scene(drive.scene, nobody, drive.truth, FACTS).figures["psnr_actors"] is None
