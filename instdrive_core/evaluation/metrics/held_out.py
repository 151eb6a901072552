"""Each held-out view is drawn once; this keeps what the figures need of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int32, UInt32, UInt64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.evaluation.metrics.box_pixels import find_moving_box_pixels
from instdrive_core.evaluation.metrics.codeword_map import render_codeword_map
from instdrive_core.evaluation.metrics.image_metrics import psnr, ssim
from instdrive_core.evaluation.metrics.segmentation import LabelledView, prepare_truth
from instdrive_core.evaluation.metrics.world_gaussians import place_world_gaussians
from instdrive_core.masks.ground_truth import GroundTruth
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene


@dataclass(frozen=True)
class HeldOutView:
    """One held-out photo against what the scene shows from there."""

    frame: Frame
    truth: UInt32[ndarray, "h w"]
    """Ground-truth IDs; 0 = ignored."""
    winner: Int32[ndarray, "h w"]
    """Row of the Gaussian that a click would hit; -1 = none."""
    codewords: UInt64[ndarray, "h w"] | None
    """Codeword + 1 of the rendered feature, 0 = none; None where the scene has no codewords."""
    psnr: float | None
    ssim: float | None
    psnr_actors: float | None
    """None where no moving object's box is in view."""

    def rename(self, named: Scene) -> HeldOutView:
        """Copy the view for a scene with other instances: a pixel stands for the one that gives it most light."""
        view = self.frame.view
        return replace(self, winner=view_scene(named, view.camera, view.time).winner)

    def with_map(self, predicted: ndarray) -> LabelledView:
        """Pair this view with a predicted map."""
        return LabelledView(self.frame.view.name, self.frame.view.time, self.truth, predicted)

    def with_ids(self, instance_ids: UInt32[ndarray, " n"] | UInt64[ndarray, " n"]) -> LabelledView:
        """Pair this view with the map that the given IDs of the scene's Gaussians make, 0 where nothing is shown."""
        padded = np.append(instance_ids, np.zeros(1, instance_ids.dtype))
        return self.with_map(padded[self.winner])  # winner -1 reads the last: 0


def measure_held_out_view(scene: Scene, clip: Clip, frame: Frame, ground_truth: GroundTruth) -> HeldOutView:
    """Draw one view and compare it with its photo. Sky and ego vehicle are ignored in maps, the latter in images.

    Where the scene knows exposures, the image is exposed as the camera's training photos before and after it were.
    The boxes of moving objects are the clip's true ones, so that runs without actors are measured on the same pixels.
    """
    camera, time = frame.view.camera, frame.view.time
    preview = view_scene(scene, camera, time)
    image, photo = preview.color, frame.load_image().astype(np.float32) / 255
    if scene.exposures is not None:
        image = apply_exposure(image, scene.exposures.interpolate(frame.view.name, time))
    image = np.clip(image, 0, 1)
    valid = np.ones(image.shape[:2], bool) if frame.valid is None else frame.valid
    ignored, sky = ~valid, ground_truth.load_sky(frame)
    if sky is not None:
        ignored = ignored | sky
    codewords = None
    if scene.code_bits:
        world = place_world_gaussians(scene, time, camera.lag)
        codewords = render_codeword_map(world, scene.gaussians.features, camera)
    return HeldOutView(
        frame=frame,
        truth=prepare_truth(ground_truth.load(frame), ignored),
        winner=preview.winner,
        codewords=codewords,
        psnr=psnr(image, photo, valid),
        ssim=ssim(image, photo, valid),
        psnr_actors=psnr(image, photo, valid & find_moving_box_pixels(camera, clip.true_tracks, time)),
    )
