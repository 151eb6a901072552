"""A stand-in for gsplat in plain torch: the four functions that `GsplatBackend` calls, with gsplat's own signatures.

As picky as the original: shapes, dtypes and channel counts are checked; culled rows hold NaN, or what looks like a
Gaussian, where gsplat leaves memory uninitialised; blending reads nothing but the tile lists; `absgrad` appears where
and when gsplat sets it.
"""

import math

import pytest
import torch

from instdrive_core.training.backends.device import explain_missing_cuda
from instdrive_core.training.backends.gsplat_backend import GsplatBackend

CHANNEL_COUNTS = {1, 2, 3, 4, 5, 8, 9, 16, 17, 32}
GPU = pytest.param("gsplat", marks=[pytest.mark.gpu, pytest.mark.filterwarnings("default")])
"""A kind of backend for `backend_of`. Compiling gsplat warns of this and that; only our own warnings are errors."""
MIN_ALPHA, MIN_TRANSMITTANCE = 1 / 255, 1e-4


def backend_of(kind: str) -> GsplatBackend:
    """`like 1.5` and `like 1.6`: on the stand-in, where `absgrad` and the largest alpha differ; `gsplat`: the real one,
    or a skip."""
    if kind != "gsplat":
        return GsplatBackend(torch.device("cpu"), TorchSplatting16() if kind == "like 1.6" else TorchSplatting())
    missing = explain_missing_cuda()
    if missing is not None:
        pytest.skip(missing)
    return GsplatBackend()


class TorchSplatting:
    """What `import gsplat` gives.

    Args:
        holder: False: the backward pass sets `means2d.absgrad` (gsplat 1.5); True: the forward pass sets it to zeros,
            which the backward pass fills (1.6). Alphas are clipped at 0.999 (1.5) or 0.99 (1.6).
    """

    __version__ = "1.5.3"

    def __init__(self, holder: bool = False) -> None:
        self.holder = holder
        self.max_alpha = 0.99 if holder else 0.999
        self.calls: list[str] = []
        self.drawn_channels: list[int] = []

    def fully_fused_projection(
        self,
        means,
        covars,
        quats,
        scales,
        viewmats,
        Ks,
        width,
        height,
        eps2d=0.3,
        near_plane=0.01,
        far_plane=1e10,
        radius_clip=0.0,
        packed=False,
        sparse_grad=False,
        calc_compensations=False,
        camera_model="pinhole",
        opacities=None,
    ):
        self.calls.append("project")
        count = len(means)
        shapes = [value.shape for value in (means, quats, scales, opacities, viewmats, Ks)]
        assert shapes == [(count, 3), (count, 4), (count, 3), (count,), (1, 4, 4), (1, 3, 3)]
        assert covars is None
        assert not packed
        assert not calc_compensations
        assert {value.dtype for value in (means, quats, scales, viewmats, Ks)} == {torch.float32}
        turn, shift, (fx, fy, cx, cy) = viewmats[0, :3, :3], viewmats[0, :3, 3], Ks[0][[0, 1, 0, 1], [0, 1, 2, 2]]
        local = means @ turn.T + shift
        x, y, z = local.unbind(1)
        middles = torch.stack([fx * x / z + cx, fy * y / z + cy], dim=1)
        wide, high = 0.15 * width / fx, 0.15 * height / fy
        slope_x = (x / z).clamp(-cx / fx - wide, (width - cx) / fx + wide)
        slope_y = (y / z).clamp(-cy / fy - high, (height - cy) / fy + high)
        zero = torch.zeros_like(z)
        jacobian = torch.stack([fx / z, zero, -fx * slope_x / z, zero, fy / z, -fy * slope_y / z], 1).view(-1, 2, 3)
        flat = jacobian @ turn @ _matrices(quats) @ torch.diag_embed(scales)
        covariances = flat @ flat.transpose(1, 2) + eps2d * torch.eye(2)
        inverse = torch.linalg.inv(covariances)
        conics = torch.stack([inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]], dim=1)
        with torch.no_grad():
            extent = (2 * torch.log(opacities / MIN_ALPHA)).clamp_min(0).sqrt().clamp_max(3.33)
            radii = (extent[:, None] * covariances.diagonal(dim1=1, dim2=2).sqrt()).ceil()
            size = torch.tensor([width, height])
            inside = ((middles + radii > 0) & (middles - radii < size)).all(dim=1)
            kept = inside & (z >= near_plane) & (opacities >= MIN_ALPHA) & (radii > radius_clip).any(dim=1)
        stale = (torch.tensor([width / 2, height / 2]), torch.tensor(1.0), torch.tensor([1.0, 0, 1]))
        old_means, old_depth, old_conic = stale if self.holder else (torch.tensor(float("nan")),) * 3
        means2d, depths = torch.where(kept[:, None], middles, old_means), torch.where(kept, z, old_depth)
        conics = torch.where(kept[:, None], conics, old_conic)
        return torch.where(kept[:, None], radii, 0).int()[None], means2d[None], depths[None], conics[None], None

    @torch.no_grad()
    def isect_tiles(
        self,
        means2d,
        radii,
        depths,
        tile_size,
        tile_width,
        tile_height,
        sort=True,
        segmented=False,
        packed=False,
        n_images=None,
        image_ids=None,
        gaussian_ids=None,
    ):
        self.calls.append("tiles")
        assert means2d.shape == (1, depths.shape[1], 2) == radii.shape
        assert sort
        assert not packed
        pairs = []
        for splat in range(depths.shape[1]):
            if (radii[0, splat] <= 0).any():
                continue
            low = torch.floor((means2d[0, splat] - radii[0, splat]) / tile_size).clamp_min(0).int().tolist()
            high = torch.ceil((means2d[0, splat] + radii[0, splat]) / tile_size).int().tolist()
            depth = int(depths[0, splat].view(torch.int32))
            for row in range(low[1], min(high[1], tile_height)):
                for column in range(low[0], min(high[0], tile_width)):
                    pairs.append(((row * tile_width + column) << 32 | depth, splat))
        pairs.sort()
        keys = torch.tensor([key for key, _ in pairs], dtype=torch.int64)
        splats = torch.tensor([splat for _, splat in pairs], dtype=torch.int32)
        return torch.bincount(splats, minlength=depths.shape[1]).int()[None], keys, splats

    @torch.no_grad()
    def isect_offset_encode(self, isect_ids, n_images, tile_width, tile_height):
        assert n_images == 1
        tiles = torch.arange(tile_width * tile_height)
        return torch.searchsorted(isect_ids >> 32, tiles).int().view(1, tile_height, tile_width)

    def rasterize_to_pixels(
        self,
        means2d,
        conics,
        colors,
        opacities,
        image_width,
        image_height,
        tile_size,
        isect_offsets,
        flatten_ids,
        backgrounds=None,
        masks=None,
        packed=False,
        absgrad=False,
    ):
        self.calls.append("blend")
        self.drawn_channels.append(colors.shape[2])
        count = means2d.shape[1]
        assert (means2d.shape, conics.shape, opacities.shape) == ((1, count, 2), (1, count, 3), (1, count))
        assert colors.shape[:2] == (1, count)
        assert colors.shape[2] in CHANNEL_COUNTS
        assert isect_offsets.shape == (1, math.ceil(image_height / tile_size), math.ceil(image_width / tile_size))
        place = (image_width, image_height, tile_size, isect_offsets, flatten_ids, self.max_alpha)
        if absgrad and self.holder:
            means2d.absgrad = torch.zeros_like(means2d)
        return _Blend.apply(means2d, conics, colors, opacities, place, absgrad, self.holder)


class TorchSplatting16(TorchSplatting):
    """What `import gsplat` gives from 1.6 on: tiles are listed by ellipses where these are given."""

    __version__ = "1.6.0"

    def __init__(self) -> None:
        super().__init__(holder=True)

    @torch.no_grad()
    def isect_tiles(
        self,
        means2d,
        radii,
        depths,
        tile_size,
        tile_width,
        tile_height,
        sort=True,
        segmented=False,
        packed=False,
        n_images=None,
        image_ids=None,
        gaussian_ids=None,
        conics=None,
        opacities=None,
    ):
        boxes = (means2d, radii, depths, tile_size, tile_width, tile_height)
        counts, keys, splats = super().isect_tiles(*boxes, sort, segmented, packed, n_images, image_ids, gaussian_ids)
        self.boxed = len(keys)
        if conics is not None and opacities is not None and len(keys):
            assert (conics.shape, opacities.shape) == ((1, depths.shape[1], 3), (1, depths.shape[1]))
            kept = self._reaches(keys >> 32, splats.long(), means2d[0], conics[0], opacities[0], tile_size, tile_width)
            keys, splats = keys[kept], splats[kept]
        self.listed = len(keys)
        return counts, keys, splats

    @staticmethod
    def _reaches(tiles, splats, means, conics, opacities, size, columns):
        """Whether a Gaussian is visible at a point of its tile; sampled densely, hence with a margin."""
        offsets = torch.linspace(0, size, 4 * size + 1)
        x = (tiles % columns * size)[:, None] + offsets - means[splats, 0, None]
        y = (tiles // columns * size)[:, None] + offsets - means[splats, 1, None]
        a, b, c = conics[splats, :, None, None].unbind(1)
        dx, dy = x[:, None, :], y[:, :, None]
        power = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        return opacities[splats] * torch.exp(-power.amin(dim=(1, 2))) * 1.05 >= MIN_ALPHA


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means2d, conics, colors, opacities, place, absgrad, holder):
        ctx.save_for_backward(means2d, conics, colors, opacities)
        ctx.place, ctx.absgrad, ctx.holder = place, absgrad, holder
        values = [tensor[0] for tensor in (means2d, conics, colors, opacities)]
        image = torch.zeros(place[1], place[0], colors.shape[2] + 1)
        for pixels, splats in _tiles(place):
            image.view(-1, image.shape[2])[pixels] = _blended(pixels, place, *(value[splats] for value in values))
        return image[None, :, :, :-1].clone(), image[None, :, :, -1:].clone()

    @staticmethod
    def backward(ctx, grad_image, grad_alpha):
        saved = ctx.saved_tensors
        grads = [torch.zeros_like(tensor[0]) for tensor in saved]
        absolute = torch.zeros_like(grads[0])
        grad = torch.cat([grad_image, grad_alpha], dim=3).view(-1, grad_image.shape[3] + 1)
        for pixels, splats in _tiles(ctx.place):
            with torch.enable_grad():
                means, *others = (tensor[0][splats].requires_grad_(True) for tensor in saved)
                apart = means.detach()[:, None].expand(-1, len(pixels), -1).clone().requires_grad_(True)
                drawn = _blended(pixels, ctx.place, apart, *others)
            of_pixels, *rest = torch.autograd.grad(drawn, (apart, *others), grad[pixels])
            absolute.index_add_(0, splats, of_pixels.abs().sum(dim=1))
            for total, part in zip(grads, (of_pixels.sum(dim=1), *rest), strict=True):
                total.index_add_(0, splats, part)
        if ctx.absgrad:
            if ctx.holder:
                saved[0].absgrad.copy_(absolute[None])
            else:
                saved[0].absgrad = absolute[None]
        return *(total[None] for total in grads), None, None, None


def _tiles(place):
    """Flat pixels and splats, nearest first, of every tile that has splats."""
    width, height, size, offsets, splats, _ = place
    ends = torch.cat([offsets.view(-1)[1:], torch.tensor([len(splats)])])
    for tile, (start, end) in enumerate(zip(offsets.view(-1).tolist(), ends.tolist(), strict=True)):
        if start < end:
            row, column = tile // offsets.shape[2] * size, tile % offsets.shape[2] * size
            rows, columns = torch.arange(row, min(row + size, height)), torch.arange(column, min(column + size, width))
            yield (rows[:, None] * width + columns).view(-1), splats[start:end].long()


def _blended(pixels, place, means, conics, colors, opacities):
    """Channels and alpha, (p, c + 1), of flat pixels; `means` may differ from pixel to pixel."""
    width, max_alpha = place[0], place[-1]
    centres = torch.stack([pixels % width + 0.5, pixels // width + 0.5], dim=1)
    dx, dy = (centres - means.view(len(means), -1, 2)).unbind(2)
    a, b, c = conics[:, :, None].unbind(1)
    raw = opacities[:, None] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
    alphas = torch.where(raw >= MIN_ALPHA, raw.clamp_max(max_alpha), 0)
    total, light = torch.zeros(len(pixels), colors.shape[1]), torch.ones(len(pixels))
    open_still = torch.ones(len(pixels), dtype=torch.bool)
    for alpha, color in zip(alphas, colors, strict=True):
        after = light * (1 - alpha)
        open_still = open_still & (after > MIN_TRANSMITTANCE)
        total = total + torch.where(open_still, light * alpha, 0)[:, None] * color
        light = torch.where(open_still, after, light)
    return torch.cat([total, 1 - light[:, None]], dim=1)


def _matrices(quats):
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1).unbind(1)
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, dim=1).view(-1, 3, 3)
