"""Keeps photos from undoing what a user edited, while the scene trains on.

A photo still shows a deleted car where it stood. If the road beside it learned from these pixels, it would take on the
car's colours, and the car would come back as a shimmer once its Gaussians are gone. So Gaussians that were edited stay
as they are, and no other learns from pixels that show them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy.ndimage import binary_dilation
from torch import Tensor

from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.gaussians.view_rendering import find_rows_of_view
from instdrive_core.training.views.training_view import TrainingView

LEAST_SHARE = 0.05
"""Share of a pixel that edited Gaussians make up, from which on nothing learns from it."""
MARGIN = 2
"""Pixels around such pixels that teach nothing either."""


class EditGuard:
    """Tells which pixels teach nothing. Answers depend on the finished scene alone, never on what was trained since.

    Args:
        start: the finished scene, as a model of its own that nobody trains.
        backend: draws it.
        edited: which rows of the finished scene were edited.
        rows: row of the finished scene of each row of `start`.
        poses: world_from_camera of each photo, as training begins with them.
    """

    def __init__(
        self,
        start: SceneModel,
        backend: Backend,
        edited: Bool[ndarray, " b"],
        rows: Int64[ndarray, " b"],
        poses: Sequence[Float64[ndarray, "4 4"]],
    ) -> None:
        start.move_to(backend.device)
        self._start, self._backend, self._poses = start, backend, tuple(poses)
        self._edited = edited
        self._edited_rows = torch.from_numpy(edited[rows]).to(backend.device)
        self._pixels: dict[int, ndarray | None] = {}
        """By photo that was asked for: packed bits of the pixels that teach, None where all do."""

    def restrict(self, number: int, view: TrainingView) -> TrainingView:
        """Cut a photo down to the pixels that teach."""
        pixels = self._find_pixels(number, view)
        if pixels is None:
            return view
        known = pixels.ravel()[view.depth_pixels]
        return replace(
            view,
            valid=pixels if view.valid is None else pixels & view.valid,
            sky=None if view.sky is None else view.sky & pixels,
            depth_pixels=view.depth_pixels[known],
            depth_values=view.depth_values[known],
        )

    def choose_learning(self, ancestors: Int64[ndarray, " v"]) -> Bool[ndarray, " v"]:
        """Choose which Gaussians may change, by the rows of the finished scene that they come from."""
        return ~self._edited[ancestors]

    def _find_pixels(self, number: int, view: TrainingView) -> Bool[ndarray, "h w"] | None:
        shape = (view.camera.height, view.camera.width)
        if number not in self._pixels:
            shares = self._draw_shares(number, view)
            shown = np.zeros(shape, bool) if shares is None else shares >= LEAST_SHARE
            near = np.asarray(binary_dilation(shown, iterations=MARGIN), bool)
            self._pixels[number] = np.packbits(~near) if near.any() else None
        packed = self._pixels[number]
        if packed is None:
            return None
        return np.unpackbits(packed, count=shape[0] * shape[1]).reshape(shape).astype(bool)

    @torch.no_grad()
    def _draw_shares(self, number: int, view: TrainingView) -> Float32[ndarray, "h w"] | None:
        """The weight of edited Gaussians in each pixel; None where none may be seen."""
        start, backend = self._start, self._backend
        camera = replace(view.camera, world_from_camera=self._poses[number])
        poses = start.actor_poses.at(view.time, start.corrections, camera.lag)
        rows, nodes = find_rows_of_view(start, backend, poses, camera)
        edited: Tensor = self._edited_rows[rows]
        if not bool(edited.any()):
            return None
        means, quats, log_scales, logits = (
            start.parameters[name][rows] for name in ("means", "quats", "log_scales", "opacity_logits")
        )
        means, quats = backend.place_gaussians(means, quats, nodes, poses.rotations, poses.shifts)
        channels = edited.float()[:, None].repeat(1, 3)
        drawn, _, _ = backend.rasterize(means, quats, log_scales, logits, channels, camera, 3)
        return drawn[..., 0].cpu().numpy()
