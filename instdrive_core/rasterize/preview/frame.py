"""A preview's frame: colour, alpha, depth and the splat that a click selects, in one pass."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.preview.blend import blend_preview
from instdrive_core.rasterize.preview.colors import know_colors
from instdrive_core.rasterize.preview.projection import project_splats
from instdrive_core.rasterize.preview.splats import NO_NAMES, ProjectedSplats
from instdrive_core.rasterize.preview.tiles import bin_preview_splats
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class PickRule:
    """Rule by which a pixel stands for one splat.

    The nearest splat that is solid enough wins. Where it carries too little of what the pixel shows (a floater in
    front), or where no splat is solid, the one at median visible depth wins: the first at which half of the
    pixel's blended weight is reached. A pixel without solid splats stands for nothing unless it is half covered.
    """

    min_opacity: float = 0.3
    """Opacity from which a splat is solid."""
    min_alpha: float = 0.2
    """α′ from which its fragment is."""
    min_share: float = 0.5
    """Share of the pixel's blended weight that the nearest solid splat must carry."""
    min_coverage: float = 0.5
    """Blended weight from which a pixel without solid splats stands for its median splat."""

    def to_row(self) -> Float32[ndarray, " 4"]:
        """Write the numbers in the order above, as the kernels take them."""
        return np.array(astuple(self), np.float32)


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
) -> Preview:
    """Draw N Gaussians (arguments as for `render`) and find the splat that each pixel stands for.

    `names` are those of `ProjectedSplats`.
    """
    means, quats, log_scales, opacities, colors = (
        to_kernel_array(array) for array in (means, quats, log_scales, opacities, colors)
    )
    workspace = Workspace()
    source = know_colors(colors)
    found = project_splats(means, quats, log_scales, opacities, camera, settings, source, workspace, names)
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
