"""The differentiable rasterizer: Gaussians × camera → channels, depth and alpha per pixel, and the way back."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Float32
from numpy import ndarray

from instdrive_core.rasterize.kernels.backward import blend_backward
from instdrive_core.rasterize.kernels.bin import TileLists, bin_splats
from instdrive_core.rasterize.kernels.blend import Blended, blend
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import Projection, project
from instdrive_core.rasterize.kernels.project_backward import RasterGradients, project_backward
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.kernels.splat_records import pack_records
from instdrive_core.scene.camera import Camera

__all__ = ["Raster", "RasterContext", "RasterGradients", "RasterSettings", "render", "render_backward"]


@dataclass(frozen=True)
class RasterContext:
    """State for the backward pass. It refers to the arrays rendered: do not change them before `render_backward`."""

    means: Float32[ndarray, "n 3"]
    quats: Float32[ndarray, "n 4"]
    log_scales: Float32[ndarray, "n 3"]
    camera: Camera
    settings: RasterSettings
    projection: Projection
    records: Float32[ndarray, "v width"]
    tiles: TileLists
    blended: Blended


@dataclass(frozen=True)
class Raster:
    """A camera's picture, with nothing behind the Gaussians: neither image nor depth is divided by alpha."""

    image: Float32[ndarray, "h w c"]
    """Σ w·channels."""
    depth: Float32[ndarray, "h w"]
    """Σ w·z, metres along the viewing axis."""
    alpha: Float32[ndarray, "h w"]
    """Σ w."""
    context: RasterContext


def render(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    channels: Float[ndarray, "n c"],
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Raster:
    """Blend N Gaussians front to back (Kerbl et al. 2023); any number of channels, none included.

    Args:
        means: metres, in the world of `camera`.
        quats: wxyz, any length above 0.
        log_scales: natural logarithm of the standard deviations in metres.
        opacities: in (0, 1).
        channels: RGB, features, anything to be blended.

    Non-finite Gaussians, those nearer than the near plane and those off the image are not drawn.
    """
    means, quats, log_scales, channels = (
        to_kernel_array(means),
        to_kernel_array(quats),
        to_kernel_array(log_scales),
        to_kernel_array(channels),
    )
    projection = project(means, quats, log_scales, to_kernel_array(opacities), camera, settings)
    tiles = bin_splats(projection, camera.width, camera.height)
    records = pack_records(projection, channels, settings)
    blended = blend(records, tiles, channels.shape[1], camera.width, camera.height, settings)
    context = RasterContext(means, quats, log_scales, camera, settings, projection, records, tiles, blended)
    return Raster(blended.image, blended.depth, blended.alpha, context)


def render_backward(
    context: RasterContext,
    grad_image: Float[ndarray, "h w c"],
    grad_depth: Float[ndarray, "h w"],
    grad_alpha: Float[ndarray, "h w"],
    geometry_channels: int,
) -> RasterGradients:
    """Compute gradients of a loss, given its gradients with respect to image, depth and alpha of `render`.

    Depth, alpha and the first `geometry_channels` channels send gradient into means, quaternions, scales and
    opacities; every channel gets its own gradient. The same input gives the same bits.

    Raises:
        ValueError: `geometry_channels` is not between 0 and the number of channels, or the picture was antialiased,
            of which no gradients are known.
    """
    if context.settings.antialiased:
        raise ValueError("gradients of antialiased pictures are not known; render without")
    count = context.blended.image.shape[2]
    if not 0 <= geometry_channels <= count:
        raise ValueError(f"geometry_channels is {geometry_channels}, expected 0 … {count}")
    grads = (to_kernel_array(grad_image), to_kernel_array(grad_depth), to_kernel_array(grad_alpha))
    with blend_backward(
        context.records, context.tiles, context.blended, grads, geometry_channels, context.settings
    ) as pair_sums:
        return project_backward(
            context.means,
            context.quats,
            context.log_scales,
            context.camera,
            context.projection,
            context.tiles,
            pair_sums,
            count,
        )
