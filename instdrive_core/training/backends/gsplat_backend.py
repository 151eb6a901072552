"""The training step on an NVIDIA GPU: gsplat draws, plain torch does the rest.

Gaussians are projected and sorted into tiles once per view, then blended once for the channels that send gradient into
geometry (depth rides along as one more), and once more, on detached geometry, for the others. Unverified on a GPU: see
docs/gpu.md.
"""

from __future__ import annotations

import importlib
import inspect
from dataclasses import dataclass
from itertools import compress
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS
from instdrive_core.scene.camera import Camera
from instdrive_core.training.backends import torch_ops
from instdrive_core.training.backends.backend import SeenSplats
from instdrive_core.training.backends.sent_arrays import SentArrays

TILE = 16
"""Pixels along a tile's side."""
CHANNEL_COUNTS = (1, 2, 3, 4, 5, 8, 9, 16, 17, 32)
"""Channel counts that every gsplat is compiled for; 1.5 pads others itself, 1.6 refuses them."""
_PHOTO_SHARE = 0.25
"""Share of the free memory that photos may stay in: Gaussians still grow."""
MAX_GEOMETRY_CHANNELS = CHANNEL_COUNTS[-1] - 1
"""Depth is drawn with them."""


class GsplatBackend:
    """`Backend` on a CUDA device. Results agree with `CpuBackend` within rounding, but not bit for bit from run to run:
    gsplat adds gradients in no fixed order.

    Args:
        device: where tensors lie; None = the current CUDA device.
        library: the gsplat module; None imports it.
        photo_bytes: how much of the device's memory photos and masks may stay in; None = a quarter of what is free
            when the first one is sent.
    """

    name = "gsplat"
    uses_kernels = False

    evaluate_harmonics = staticmethod(torch_ops.evaluate_harmonics)
    place_gaussians = staticmethod(torch_ops.place_gaussians)
    sum_rigid_gradient = staticmethod(torch_ops.sum_rigid_gradient)
    composite_over_sky = staticmethod(torch_ops.composite_over_sky)
    expose = staticmethod(torch_ops.expose)
    depth_loss = staticmethod(torch_ops.depth_loss)

    def __init__(self, device: torch.device | None = None, library: Any = None, photo_bytes: int | None = None) -> None:
        self.device = device or torch.device("cuda", torch.cuda.current_device())
        self._library = library or importlib.import_module("gsplat")
        self.photos = SentArrays(self._choose_photo_bytes if photo_bytes is None else lambda: photo_bytes)
        """Photos and masks that lie on the device, as bytes."""

    def photometric_loss(
        self,
        image: Float[Tensor, "h w 3"],
        target: UInt8[ndarray, "h w 3"],
        valid: Bool[ndarray, "h w"] | None,
        ssim_weight: float,
    ) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """See `Backend.photometric_loss`."""
        mask = None if valid is None else self._put(valid)
        return torch_ops.photometric_loss(image, self._put(target), mask, ssim_weight)

    def opacity_loss(self, alpha: Float[Tensor, "h w"], pixels: Bool[ndarray, "h w"], solid: bool) -> Float[Tensor, ""]:
        """See `Backend.opacity_loss`."""
        return torch_ops.opacity_loss(alpha, self._put(pixels), solid)

    def _put(self, array: ndarray) -> Tensor:
        return self.photos.find_or_send(array, lambda array: torch_ops.to_device(array, self.device))

    def _choose_photo_bytes(self) -> int:
        free = torch.cuda.mem_get_info(self.device)[0] if self.device.type == "cuda" else 0
        return int(_PHOTO_SHARE * free)

    def rasterize(
        self,
        means: Float[Tensor, "v 3"],
        quats: Float[Tensor, "v 4"],
        log_scales: Float[Tensor, "v 3"],
        opacity_logits: Float[Tensor, " v"],
        channels: Float[Tensor, "v c"],
        camera: Camera,
        geometry_channels: int,
        seen: SeenSplats | None = None,
    ) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
        """See `Backend.rasterize`.

        Raises:
            ValueError: `geometry_channels` is not between 0 and the number of channels, or is more than 31.
        """
        count = min(channels.shape[1], MAX_GEOMETRY_CHANNELS)
        if not 0 <= geometry_channels <= count:
            raise ValueError(f"geometry_channels is {geometry_channels}, expected 0 … {count}")
        request = _Request(self._library, camera, geometry_channels, seen, torch.is_grad_enabled())
        return _Rasterize.apply(means, quats, log_scales, opacity_logits, channels, request)


@dataclass(frozen=True)
class _Request:
    library: Any
    camera: Camera
    geometry_channels: int
    seen: SeenSplats | None
    differentiable: bool


@dataclass(frozen=True)
class _Projected:
    """gsplat's 2D Gaussians of one camera; rows with a radius of 0 are culled and hold uninitialised memory."""

    radii: Int[Tensor, "1 v 2"]
    """Pixels, rounded up; of the box in which the Gaussian reaches the alpha limit."""
    means: Float[Tensor, "1 v 2"]
    depths: Float[Tensor, "1 v"]
    conics: Float[Tensor, "1 v 3"]
    opacities: Float[Tensor, "1 v"]

    def detach(self) -> _Projected:
        """Copy these 2D Gaussians as constants, to which no gradient flows."""
        return _Projected(*(getattr(self, name).detach() for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class _Tiles:
    offsets: Int[Tensor, "1 rows columns"]
    splats: Int[Tensor, " pairs"]


class _Rasterize(torch.autograd.Function):
    """One node around gsplat's own graph, so that `seen` is filled where that graph's gradients are at hand."""

    @staticmethod
    def forward(ctx, means, quats, log_scales, opacity_logits, channels, request: _Request):
        tensors = (means, quats, log_scales, opacity_logits, channels)
        wanted = [request.differentiable and needed for needed in ctx.needs_input_grad[: len(tensors)]]
        # detach() keeps counting changes in place: gsplat's graph notices them in its backward pass.
        leaves = [tensor.detach().requires_grad_(grad) for tensor, grad in zip(tensors, wanted, strict=True)]
        with torch.set_grad_enabled(any(wanted)):
            projected, outputs = _draw(leaves, request)
        ctx.leaves, ctx.projected, ctx.outputs, ctx.request = leaves, projected, outputs, request
        return tuple(output.detach() for output in outputs)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grad_outputs):  # pyright: ignore[reportIncompatibleMethodOverride]
        leaves = [leaf for leaf in ctx.leaves if leaf.requires_grad]
        kept = [output.requires_grad for output in ctx.outputs]
        outputs, grads = compress(ctx.outputs, kept), compress(grad_outputs, kept)
        gradients = iter(torch.autograd.grad(tuple(outputs), leaves, tuple(grads), allow_unused=True))
        if ctx.request.seen is not None:
            _fill(ctx.request.seen, ctx.projected, ctx.request.camera)
        return *(next(gradients) if leaf.requires_grad else None for leaf in ctx.leaves), None


def _draw(leaves: list[Tensor], request: _Request) -> tuple[_Projected, tuple[Tensor, Tensor, Tensor]]:
    """Image, depth and alpha, with gsplat's graph behind them."""
    means, quats, log_scales, opacity_logits, channels = leaves
    camera, reaching = request.camera, request.geometry_channels
    if not len(means):
        return _draw_nothing(leaves, camera)
    projected = _project(request.library, means, quats, log_scales, opacity_logits.sigmoid(), camera)
    tiles = _list_tiles(request.library, projected, camera)
    with_depth = torch.cat([channels[:, :reaching], projected.depths[0, :, None]], dim=1)
    first, alpha = _blend(request.library, projected, tiles, with_depth, camera, request.seen is not None)
    parts, fixed = [first[:, :, :reaching]], projected.detach()
    if channels.shape[1] > reaching:
        for part in channels[:, reaching:].split(CHANNEL_COUNTS[-1], dim=1):
            parts.append(_blend(request.library, fixed, tiles, part, camera, False)[0])
    return projected, (torch.cat(parts, dim=2), first[:, :, reaching], alpha)


def _draw_nothing(leaves: list[Tensor], camera: Camera) -> tuple[_Projected, tuple[Tensor, Tensor, Tensor]]:
    """Draw no Gaussians: black, without starting a kernel. The sum over nothing keeps the graph whole."""
    channels, zero = leaves[-1], torch.stack([leaf.sum() for leaf in leaves]).sum()
    floats: Any = {"dtype": channels.dtype, "device": channels.device}
    radii = torch.zeros(1, 0, 2, dtype=torch.int32, device=channels.device)
    empty = (torch.zeros(1, 0, *shape, **floats) for shape in ((2,), (), (3,), ()))
    image = torch.zeros(camera.height, camera.width, channels.shape[1], **floats)
    depth, alpha = (torch.zeros(camera.height, camera.width, **floats) for _ in range(2))
    return _Projected(radii, *empty), (image + zero, depth + zero, alpha + zero)


def _project(
    library: Any, means: Tensor, quats: Tensor, log_scales: Tensor, opacities: Tensor, camera: Camera
) -> _Projected:
    view = torch.from_numpy(camera.camera_from_world).to(means)
    intrinsics = torch.from_numpy(camera.intrinsics).to(means)
    radii, means2d, depths, conics, _ = library.fully_fused_projection(
        means,
        None,
        quats,
        log_scales.exp(),
        view[None],
        intrinsics[None],
        camera.width,
        camera.height,
        eps2d=DEFAULT_SETTINGS.low_pass,
        near_plane=DEFAULT_SETTINGS.near,
        opacities=opacities.detach(),  # makes the boxes as tight as the alpha limit allows
    )
    return _Projected(radii, means2d, depths, conics, opacities[None])


@torch.no_grad()
def _list_tiles(library: Any, projected: _Projected, camera: Camera) -> _Tiles:
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    boxes = projected.means, projected.radii, projected.depths
    # gsplat 1.6 leaves out the tiles of a box that its ellipse does not reach.
    knows_ellipses = {"conics", "opacities"} <= inspect.signature(library.isect_tiles).parameters.keys()
    ellipses = {"conics": projected.conics, "opacities": projected.opacities} if knows_ellipses else {}
    _, keys, splats = library.isect_tiles(*boxes, TILE, columns, rows, **ellipses)
    return _Tiles(library.isect_offset_encode(keys, 1, columns, rows).reshape(1, rows, columns), splats)


def _blend(
    library: Any, projected: _Projected, tiles: _Tiles, channels: Float[Tensor, "v c"], camera: Camera, absgrad: bool
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"]]:
    count = channels.shape[1]
    compiled = next(number for number in CHANNEL_COUNTS if number >= count)
    image, alpha = library.rasterize_to_pixels(
        projected.means,
        projected.conics,
        F.pad(channels, (0, compiled - count))[None],
        projected.opacities,
        camera.width,
        camera.height,
        TILE,
        tiles.offsets,
        tiles.splats,
        absgrad=absgrad,
    )
    return image[0, :, :, :count], alpha[0, :, :, 0]


@torch.no_grad()
def _fill(seen: SeenSplats, projected: _Projected, camera: Camera) -> None:
    """After gsplat's backward pass, which leaves the absolute gradients, in pixels, on the tensor of 2D means."""
    side = max(camera.width, camera.height)
    opacities = projected.opacities[0]
    a, b, c = projected.conics[0].double().unbind(1)  # a thin splat's determinant cancels in float32
    determinant = a * c - b * b
    xx, yy = c / determinant, a / determinant
    reach = (2 * torch.log(opacities / DEFAULT_SETTINGS.min_alpha)).clamp_min(0)
    visible = (projected.radii[0] > 0).all(dim=1)
    for axis, variance, size in ((0, xx, camera.width), (1, yy, camera.height)):
        middle, extent = projected.means[0, :, axis] - 0.5, (reach * variance).sqrt()
        first, last = (middle - extent).ceil().clamp_min(0), (middle + extent).floor().clamp_max(size - 1)
        visible &= first <= last
    absolute = getattr(projected.means, "absgrad", None)
    lengths = torch.zeros_like(opacities) if absolute is None else absolute[0].norm(dim=1) * (0.5 * side)
    seen.visible = visible
    seen.gradients = torch.where(visible, lengths, 0)
