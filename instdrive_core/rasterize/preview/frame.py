"""A preview's frame: colour, alpha, depth and the splat that a click selects, in one pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.preview.blend import blend_preview
from instdrive_core.rasterize.preview.colors import know_colors
from instdrive_core.rasterize.preview.projection import project_splats
from instdrive_core.rasterize.preview.splats import NO_INSTANCES, NO_NAMES, ProjectedSplats
from instdrive_core.rasterize.preview.tiles import bin_preview_splats
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class PickRule:
    """Rule by which a pixel stands for one splat.

    The instance that gives the pixel most of its light wins. So no floater in front decides, nor what shines through an
    object's edge. Two instances are counted at a time, front to back; a splat of a third takes the place of the one
    that gave less so far if it gives more by itself. Once nothing behind can change who wins, the winner's heaviest
    splat so far is what the pixel stands for. A pixel without solid splats stands for nothing unless it is half
    covered.
    """

    min_opacity: float = 0.3
    """Opacity from which a splat is solid."""
    min_alpha: float = 0.2
    """α′ from which its fragment is."""
    min_coverage: float = 0.5
    """Blended weight from which a pixel without solid splats stands for anything."""
    nearest: bool = False
    """Whether the nearest solid splat wins instead, whatever lies behind; without one a pixel stands for nothing."""

    def to_row(self) -> Float32[ndarray, " 4"]:
        """Write opacity, alpha, coverage and whether the nearest wins, as the kernels take them."""
        coverage = 2.0 if self.nearest else self.min_coverage
        return np.array([self.min_opacity, self.min_alpha, coverage, self.nearest], np.float32)


DEFAULT_PICK_RULE = PickRule()


@dataclass(frozen=True)
class Preview:
    """One frame."""

    color: Float32[ndarray, "h w 3"]
    """Σ w·colour, premultiplied by alpha, over what lies behind."""
    alpha: Float32[ndarray, "h w"]
    depth: Float32[ndarray, "h w"]
    """Expected depth Σ w·z / Σ w in metres along the viewing axis; 0 where nothing is drawn."""
    winner: Int32[ndarray, "h w"]
    """Row of the splat that a click selects, -1 for none."""


def render_preview(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    colors: Float[ndarray, "n 3"],
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
    rule: PickRule = DEFAULT_PICK_RULE,
    names: Int32[ndarray, " k"] = NO_NAMES,
    instances: UInt32[ndarray, " m"] = NO_INSTANCES,
) -> Preview:
    """Draw N Gaussians (arguments as for `render`) and find the splat that each pixel stands for.

    `names` and `instances` are those of `ProjectedSplats`.
    """
    means, quats, log_scales, opacities, colors = (
        to_kernel_array(array) for array in (means, quats, log_scales, opacities, colors)
    )
    workspace = Workspace()
    source = know_colors(colors)
    found = project_splats(means, quats, log_scales, opacities, camera, settings, source, workspace, names, instances)
    return blend_projected(found, camera, workspace, settings, rule)


def blend_projected(
    found: ProjectedSplats,
    camera: Camera,
    workspace: Workspace,
    settings: RasterSettings = DEFAULT_SETTINGS,
    rule: PickRule = DEFAULT_PICK_RULE,
    behind: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Preview:
    """Blend what `project_splats` found with the same camera and settings.

    `behind` is the RGB of what shows where splats let light through. Pictures lie in the workspace: they last until
    the next call with the same one. The winners are the caller's.
    """
    tiles = bin_preview_splats(found, camera.width, camera.height, workspace)
    shape = (camera.height, camera.width)
    result = Preview(
        workspace.get_array("color", (*shape, 3)),
        workspace.get_array("alpha", shape),
        workspace.get_array("depth", shape),
        np.empty(shape, np.int32),
    )
    images = (result.color, result.alpha, result.depth, result.winner)
    blend_preview(found.lines, tiles, settings, rule.to_row(), np.array(behind, np.float32), images)
    return result
