"""The operations of a training step in plain torch, on whatever device the tensors are: all of `Backend` but drawing.

Values and gradients are those of the CPU's own kernels within rounding; those are faster on a CPU, these run on a GPU.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Float64, Int, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import extract_node_rotations
from instdrive_core.training.backends.backend import Nodes, NodesOnDevice

_SHOWS = 1 / 1024
"""Pixels that let less light through than this show no sky, as in `rasterize.kernels.sky_behind`."""
_DRAWN = 0.05
"""Pixels with less opacity than this have no expected depth."""
_OPACITY_FLOOR = 1e-4
"""Keeps the logarithm of the opacity terms finite where alpha is the very opposite of what is wanted."""

_RADIUS, _SIGMA = 5, 1.5
_C1, _C2 = 0.01**2, 0.03**2
"""SSIM's window and constants, as in `backends.photometric`."""


def to_device(array: ndarray | Tensor, device: torch.device) -> Tensor:
    """The array as a tensor there; shares its memory on the CPU where the array may be written. Tensors stay.

    On its way to a GPU it goes through pinned memory, so that nobody waits for what the GPU has still to do.
    """
    if isinstance(array, Tensor):
        return array
    tensor = torch.from_numpy(np.require(array, requirements=["C", "W"]))
    return tensor.pin_memory().to(device, non_blocking=True) if device.type == "cuda" else tensor.to(device)


def put_nodes_on(nodes: Nodes, device: torch.device) -> NodesOnDevice:
    """Nodes as plain torch takes them."""
    if isinstance(nodes, NodesOnDevice):
        return nodes
    moved = np.flatnonzero(nodes)
    background = int(moved[0]) if len(moved) else len(nodes)
    return NodesOnDevice(to_device(nodes.astype(np.int64), device), background)


def place_gaussians(
    means: Float[Tensor, "v 3"],
    quats: Float[Tensor, "v 4"],
    nodes: Nodes,
    rotations: Float[Tensor, "m 3 3"],
    shifts: Float[Tensor, "m 3"],
) -> tuple[Float[Tensor, "v 3"], Float[Tensor, "v 4"]]:
    """See `Backend.place_gaussians`. Quaternions are chosen among four candidates, as in `maths.rotations`."""
    places = put_nodes_on(nodes, means.device)
    still, which = places.background, places.of_rows[places.background :]
    if not len(which):
        return means, quats
    own_means, own_quats = means[still:], quats[still:]
    # Indexing by `which`, not index_select: its backward pass adds duplicates in fixed order on a GPU too.
    placed_means = (rotations[which] * own_means[:, None, :]).sum(dim=2) + shifts[which]
    placed_quats = _multiply_quaternions(quaternions_from_matrices(rotations)[which], own_quats)
    return torch.cat([means[:still], placed_means]), torch.cat([quats[:still], placed_quats])


def sum_rigid_gradient(
    means: Float[Tensor, "v 3"],
    quats: Float[Tensor, "v 4"],
    grad_means: Float[Tensor, "v 3"],
    grad_quats: Float[Tensor, "v 4"],
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    """See `Backend.sum_rigid_gradient`."""
    backwards = quats.detach().double() * torch.tensor([1.0, -1.0, -1.0, -1.0], device=quats.device).double()
    half_turns = 0.5 * _multiply_quaternions(grad_quats.double(), backwards)[:, 1:]
    torques = torch.linalg.cross(means.detach().double(), grad_means.double()) + half_turns
    force, torque = torch.stack([grad_means.double().sum(dim=0), torques.sum(dim=0)]).cpu().numpy()
    return force, torque


def quaternions_from_matrices(matrices: Float[Tensor, "m 3 3"]) -> Float[Tensor, "m 4"]:
    """Unit quaternions wxyz (w ≥ 0) of rotation matrices, differentiable by all nine entries."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(1) for row in matrices.unbind(1))
    candidates = torch.stack(
        [
            torch.stack([1 + xx + yy + zz, zy - yz, xz - zx, yx - xy], dim=1),
            torch.stack([zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx], dim=1),
            torch.stack([xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy], dim=1),
            torch.stack([yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz], dim=1),
        ],
        dim=1,
    )
    best = candidates.diagonal(dim1=1, dim2=2).argmax(dim=1)
    chosen = candidates[torch.arange(len(best), device=best.device), best]
    unit = chosen / chosen.norm(dim=1, keepdim=True)
    return torch.where(unit[:, :1] < 0, -unit, unit)


def _multiply_quaternions(left: Float[Tensor, "k 4"], right: Float[Tensor, "k 4"]) -> Float[Tensor, "k 4"]:
    """Hamilton product: rotate by `right`, then by `left`."""
    w, x, y, z = left.unbind(1)
    a, b, c, d = right.unbind(1)
    return torch.stack(
        [
            w * a - x * b - y * c - z * d,
            x * a + w * b - z * c + y * d,
            y * a + z * b + w * c - x * d,
            z * a - y * b + x * c + w * d,
        ],
        dim=1,
    )


def evaluate_harmonics(
    means: Float[Tensor, "v 3"],
    sh_dc: Float[Tensor, "v 3"],
    sh_rest: Float[Tensor, "v k 3"],
    camera_position: Float64[ndarray, "3"],
    nodes: Nodes | None = None,
    poses: Float64[ndarray, "m 4 4"] | None = None,
) -> Float[Tensor, "v 3"]:
    """See `Backend.evaluate_harmonics`. Colours are clamped at 0; channels that are send no gradient back."""
    colors = 0.5 + Y0 * sh_dc
    if sh_rest.shape[1]:
        with torch.no_grad():
            directions = means - to_device(camera_position.astype(np.float32), means.device)
            if nodes is not None and poses is not None and len(poses) > 1:
                turns = to_device(extract_node_rotations(poses).astype(np.float32), means.device)
                places = put_nodes_on(nodes, means.device)
                still, which = places.background, places.of_rows[places.background :]
                turned = (turns[which] * directions[still:, :, None]).sum(dim=1)  # Rᵀ d
                directions = torch.cat([directions[:still], turned])
            length = directions.square().sum(dim=1, keepdim=True).clamp_min(1e-12).sqrt()
            basis = evaluate_basis(directions / length, sh_rest.shape[1])
        colors = colors + (basis[:, :, None] * sh_rest).sum(dim=1)
    return torch.relu(colors)


def evaluate_basis(directions: Float[Tensor, "v 3"], count: int) -> Float[Tensor, "v {count}"]:
    """The first `count` (3, 8 or 15) values of `maths.spherical_harmonics.evaluate_rest_basis`, for unit directions."""
    x, y, z = directions.unbind(1)
    xx, yy, zz = x * x, y * y, z * z
    values = [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if count > 3:
        values += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
        ]
    if count > 8:
        values += [
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * (xx + yy)),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ]
    return torch.stack(values, dim=1)


def composite_over_sky(
    image: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"], faces: Float[Tensor, "6 r r 3"], camera: Camera
) -> Float[Tensor, "h w 3"]:
    """See `Backend.composite_over_sky`; texels are read bilinearly as by `scene.sky.find_cube_taps`."""
    through = 1 - alpha
    through = torch.where(through < _SHOWS, 0, through)
    texels, weights = _cube_taps(_ray_directions(camera, image.device), faces.shape[1])
    flat = faces.reshape(-1, 3)
    sky = torch.zeros_like(image)
    for tap in range(4):
        sky = sky + weights[tap, :, :, None] * flat.index_select(0, texels[tap].reshape(-1)).view_as(image)
    return image + through[:, :, None] * sky


@torch.no_grad()
def _ray_directions(camera: Camera, device: torch.device) -> Float64[Tensor, "h w 3"]:
    """World directions through all pixel centres, not normalised."""
    x = (torch.arange(camera.width, dtype=torch.float64, device=device) + 0.5 - camera.cx) / camera.fx
    y = (torch.arange(camera.height, dtype=torch.float64, device=device) + 0.5 - camera.cy) / camera.fy
    right, down, forward = to_device(camera.world_from_camera[:3, :3], device).unbind(1)
    return x[None, :, None] * right + y[:, None, None] * down + forward


@torch.no_grad()
def _cube_taps(
    directions: Float64[Tensor, "h w 3"], resolution: int
) -> tuple[Int64[Tensor, "4 h w"], Float[Tensor, "4 h w"]]:
    """The four texels (row-major over 6 × resolution²) and bilinear weights that each direction reads."""
    along_x, along_y, along_z = directions.abs().unbind(2)
    axis = torch.where((along_x >= along_y) & (along_x >= along_z), 0, torch.where(along_y >= along_z, 1, 2))
    axes = torch.stack([axis, (axis + 1) % 3, (axis + 2) % 3], dim=2)
    major, first, second = directions.gather(2, axes).unbind(2)
    face = axis * 2 + (major < 0)
    scale = 0.5 / major.abs().clamp_min(1e-12)
    u, v = ((tangent * scale + 0.5) * resolution - 0.5 for tangent in (first, second))
    u, v = u.clamp(0, resolution - 1), v.clamp(0, resolution - 1)
    column, row = (place.long().clamp_max(max(resolution - 2, 0)) for place in (u, v))
    right, below = (column + 1).clamp_max(resolution - 1), (row + 1).clamp_max(resolution - 1)
    du, dv = u - column, v - row
    above, under = (face * resolution + row) * resolution, (face * resolution + below) * resolution
    texels = torch.stack([above + column, above + right, under + column, under + right])
    weights = torch.stack([(1 - dv) * (1 - du), (1 - dv) * du, dv * (1 - du), dv * du])
    return texels, weights.float()


def expose(image: Float[Tensor, "h w 3"], exposure: Float[Tensor, "3 4"]) -> Float[Tensor, "h w 3"]:
    """See `Backend.expose`."""
    return image @ exposure[:, :3].T + exposure[:, 3]


def photometric_loss(
    image: Float[Tensor, "h w 3"],
    target: UInt8[ndarray, "h w 3"] | UInt8[Tensor, "h w 3"],
    valid: Bool[ndarray, "h w"] | Bool[Tensor, "h w"] | None,
    ssim_weight: float,
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """See `Backend.photometric_loss`; photo and mask may lie on the device already.

    Pixels that are not valid count as equal: they add to neither term.
    """
    wanted = to_device(target, image.device).to(image.dtype) / 255
    mask = None if valid is None else to_device(valid, image.device)
    with torch.no_grad():
        squared = (image.clamp(0, 1) - wanted).square()
        if mask is None:
            error = squared.sum() / max(squared.numel(), 1)
        else:
            error = torch.where(mask[:, :, None], squared, 0).sum() / (3 * mask.sum()).clamp_min(1)
        psnr = -10 * torch.log10(error.clamp_min(1e-10))
    compared = image if mask is None else torch.where(mask[:, :, None], image, wanted)
    return _Photometric.apply(compared, wanted, ssim_weight), psnr


class _Photometric(torch.autograd.Function):
    """(1 - w) L1 + w (1 - SSIM) with the closed-form gradient of `backends.photometric`: nothing is kept but that."""

    @staticmethod
    def forward(ctx, image: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
        x, y = image.permute(2, 0, 1), target.permute(2, 0, 1)
        similarity, gradient = _ssim_and_gradient(x, y)
        difference = x - y
        gradient = difference.sign() * (1 - ssim_weight) - gradient * ssim_weight
        ctx.save_for_backward((gradient / x.numel()).permute(1, 2, 0).contiguous())
        return (1 - ssim_weight) * difference.abs().mean() + ssim_weight * (1 - similarity)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return ctx.saved_tensors[0] * grad, None, None


def _ssim_and_gradient(
    x: Float[Tensor, "c h w"], y: Float[Tensor, "c h w"]
) -> tuple[Float[Tensor, ""], Float[Tensor, "c h w"]]:
    """Mean SSIM and the gradient of the SSIM map's *sum* with respect to `x`."""
    mx, my, sxx, syy, sxy = _blur(torch.cat([x, y, x * x, y * y, x * y])).chunk(5)
    a1, a2 = 2 * mx * my + _C1, 2 * (sxy - mx * my) + _C2
    b1, b2 = mx * mx + my * my + _C1, sxx - mx * mx + syy - my * my + _C2
    inverse = 1 / (b1 * b2)
    similarity = a1 * a2 * inverse
    by_product, by_square = 2 * a1 * inverse, -similarity / b2
    by_mean = 2 * my * a2 * inverse - my * by_product - 2 * mx * similarity / b1 - 2 * mx * by_square
    mean, square, product = _blur(torch.cat([by_mean, by_square, by_product])).chunk(3)
    return similarity.mean(), mean + 2 * x * square + y * product


def _blur(planes: Float[Tensor, "p h w"]) -> Float[Tensor, "p h w"]:
    """Every plane under the Gaussian window, zeros around it."""
    count = len(planes)
    steps = torch.arange(-_RADIUS, _RADIUS + 1, device=planes.device, dtype=planes.dtype)
    taps = torch.exp(-steps.square() / (2 * _SIGMA**2))
    taps = (taps / taps.sum()).expand(count, 1, 1, -1)
    # SSIM subtracts nearly equal moments: TF32, which cuDNN uses by default, would leave noise.
    with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
        rows = F.conv2d(planes[None], taps, padding=(0, _RADIUS), groups=count)
        return F.conv2d(rows, taps.transpose(2, 3), padding=(_RADIUS, 0), groups=count)[0]


def depth_loss(
    depth: Float[Tensor, "h w"],
    alpha: Float[Tensor, "h w"],
    pixels: Int[ndarray, " k"],
    lidar_depths: Float[ndarray, " k"],
) -> Float[Tensor, ""]:
    """See `Backend.depth_loss`."""
    where = to_device(pixels.astype(np.int64), depth.device)
    wanted = to_device(lidar_depths.astype(np.float32), depth.device)
    drawn, opacity = depth.reshape(-1)[where], alpha.reshape(-1)[where]
    counts = opacity.detach() > _DRAWN
    expected = drawn / torch.where(counts, opacity, 1)
    return torch.where(counts, (expected - wanted).abs(), 0).sum() / counts.sum().clamp_min(1)


def opacity_loss(
    alpha: Float[Tensor, "h w"], pixels: Bool[ndarray, "h w"] | Bool[Tensor, "h w"], solid: bool
) -> Float[Tensor, ""]:
    """See `Backend.opacity_loss`; the pixels may lie on the device already."""
    cost = -torch.log((alpha if solid else 1 - alpha).clamp_min(_OPACITY_FLOOR))
    return torch.where(to_device(pixels, alpha.device), cost, 0).sum() / alpha.numel()
