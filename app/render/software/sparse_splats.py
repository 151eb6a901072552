"""Every k-th splat of a large scene, made larger: what drafts show until levels of detail are there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from instdrive_app.render.software.placed_splats import PlacedSplats
from instdrive_core.formats.allocation import enlarge_splats
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.preview.colors import ColorSource
from instdrive_core.rasterize.preview.projection import project_splats
from instdrive_core.rasterize.preview.splats import ProjectedSplats
from instdrive_core.scene.camera import Camera

LEAST, MOST = 2_000_000, 300_000
"""Splats from which a scene is so large that looking at all of them takes longer than a draft may, and splats shown."""


class SparseSplats:
    """Some splats of all over a scene, gathered again when they look different. Only the render thread uses it."""

    def __init__(self, placed: PlacedSplats) -> None:
        self._placed, self.look_version = placed, placed.look_version
        every = -(-len(placed.means) // MOST)
        self.rows = np.arange(0, len(placed.means), every, dtype=np.int32)
        self._means, self._quats = placed.means[self.rows], placed.quats[self.rows]
        self._log_scales, self._opacities = placed.log_scales[self.rows], placed.opacities[self.rows]
        enlarge_splats(self._log_scales, every)

    def is_of(self, placed: PlacedSplats) -> bool:
        """Whether the splats look as the scene does now."""
        return placed is self._placed and placed.look_version == self.look_version

    def project(
        self, camera: Camera, source: ColorSource, settings: RasterSettings, workspace: Workspace
    ) -> ProjectedSplats:
        """Project and colour them; `source` is that of the whole scene."""
        shapes = self._means, self._quats, self._log_scales, self._opacities
        frames = source.frames[self.rows] if len(source.frames) else source.frames
        own = replace(source, frames=frames, entries=source.entries[self.rows], sources=self.rows)
        called = self._placed.name(self.rows), self._placed.state.instance_ids
        return project_splats(*shapes, camera, settings, own, workspace, *called)
