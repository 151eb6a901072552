"""Fragments of one pixel, without drawing the frame: clicks and hovering read them."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Float32, Int32, Int64, UInt32
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import TILE
from instdrive_core.rasterize.kernels.fragment import FLOOR, compute_exponent, power_of_two
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import DEPTH, OPACITY, camera_to_row, project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE, PickRule
from instdrive_core.rasterize.preview.splats import NO_NAMES
from instdrive_core.scene.camera import Camera

_CHUNK = 1 << 14
_NOBODY = -1
"""Owner of fragments that no pixel stands for."""


@dataclass(frozen=True)
class Contributors:
    """Fragments at one pixel, front to back."""

    rows: Int32[ndarray, " k"]
    alphas: Float32[ndarray, " k"]
    """α′."""
    weights: Float32[ndarray, " k"]
    """Weights in the pixel's colour; 0 where what is in front lets no light through."""
    depths: Float32[ndarray, " k"]
    """z in metres."""
    opacities: Float32[ndarray, " k"]
    """Opacities of the splats, as drawn."""

    @property
    def blended(self) -> Contributors:
        """Fragments that the pixel's colour is made of."""
        seen = np.flatnonzero(self.weights)
        return Contributors(
            self.rows[seen], self.alphas[seen], self.weights[seen], self.depths[seen], self.opacities[seen]
        )


def find_fragments_among(
    near: Int64[ndarray, " k"],
    means: Float[ndarray, "k 3"],
    quats: Float[ndarray, "k 4"],
    log_scales: Float[ndarray, "k 3"],
    opacities: Float[ndarray, " k"],
    camera: Camera,
    x: int,
    y: int,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Contributors:
    """Find all that reaches pixel (column x, row y), hidden or not, given only the rows `near` it and their splats."""
    means, quats, log_scales, opacities = (to_kernel_array(array) for array in (means, quats, log_scales, opacities))
    projection = project(means, quats, log_scales, opacities, camera, settings)
    left, top = x // TILE * TILE, y // TILE * TILE
    alphas = np.zeros(len(projection.rows), np.float32)
    _alphas_at(projection.splats, np.float32(left), np.float32(top), x - left, y - top, settings.to_row(), alphas)
    behind = np.cumprod(1 - alphas)
    reaching = np.flatnonzero(alphas > 0)
    behind_each = behind[reaching]
    before = np.concatenate([np.ones(1, np.float32), behind])[reaching]
    weights = np.where(behind_each > np.float32(settings.min_transmittance), before - behind_each, np.float32(0))
    return Contributors(
        near[projection.rows[reaching]].astype(np.int32),
        alphas[reaching],
        weights,
        projection.splats[reaching, DEPTH],
        projection.splats[reaching, OPACITY],
    )


def pick_winner(
    contributors: Contributors,
    rule: PickRule = DEFAULT_PICK_RULE,
    instances: UInt32[ndarray, " n"] | None = None,
    names: Int32[ndarray, " k"] = NO_NAMES,
) -> int:
    """Pick the row that the pixel stands for, by the rule of `render_preview`; -1 for none.

    `instances` holds the instance of each row of the scene; without it all are of one. `names` are those of
    `ProjectedSplats`.
    """
    rows, weights = contributors.rows, contributors.weights
    named = names[rows] >= 0 if len(names) else np.ones(len(rows), bool)
    solid = named & (contributors.opacities >= rule.min_opacity) & (contributors.alphas >= rule.min_alpha)
    if rule.nearest:
        return int(rows[np.argmax(solid)]) if solid.any() else -1
    if not named.any() or (not solid.any() and weights.sum() < rule.min_coverage):
        return -1
    owners = np.zeros(len(rows), np.int64) if instances is None else instances[rows].astype(np.int64)
    heaviest = max(_count_two(np.where(named, owners, _NOBODY), weights), key=lambda place: place.light)
    return int(rows[heaviest.fragment])


@dataclass
class _Place:
    """One of the two instances that are counted."""

    name: int | None = None
    light: float = 0.0
    weight: float = 0.0
    fragment: int = -1

    def add(self, fragment: int, weight: float) -> None:
        self.light += weight
        if weight > self.weight:
            self.fragment, self.weight = fragment, weight


def _count_two(owners: Int64[ndarray, " k"], weights: Float32[ndarray, " k"]) -> tuple[_Place, _Place]:
    """Count the light of two instances, front to back, as `PickRule` says; those of nobody do not count."""
    first, second, left = _Place(), _Place(), 1.0
    for fragment, (name, weight) in enumerate(zip(owners.tolist(), weights, strict=True)):
        left -= weight
        if name == _NOBODY:
            continue
        place = first if name == first.name else second
        if name not in (first.name, second.name):
            place = first if second.light >= first.light else second
            if not weight > place.light:
                continue
            place.name, place.light, place.weight = name, 0.0, 0.0
        place.add(fragment, weight)
        if abs(first.light - second.light) >= left:
            break
    return first, second


def find_rows_near_pixel(
    means: Float[ndarray, "n 3"],
    log_sizes: Float[ndarray, "n a"],
    opacities: Float[ndarray, " n"],
    camera: Camera,
    x: int,
    y: int,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Int64[ndarray, " k"]:
    """Find the rows, rising, whose splat may reach pixel (column x, row y): a bound far cheaper than the projection.

    `log_sizes` are log scales, or only the largest of each row. Raises ValueError where the pixel is outside the image.
    """
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise ValueError(f"pixel ({x}, {y}) is outside the {camera.width} × {camera.height} image")
    means, log_sizes, opacities = (to_kernel_array(array) for array in (means, log_sizes, opacities))
    chunks = -(-len(means) // _CHUNK)
    found, counts = np.empty(len(means), np.int64), np.zeros(chunks, np.int64)
    pixel = np.array([x + 0.5, y + 0.5], np.float32)
    _find_near(means, log_sizes, opacities, camera_to_row(camera), settings.to_row(), pixel, found, counts)
    return np.concatenate([found[k * _CHUNK : k * _CHUNK + counts[k]] for k in range(chunks)] or [found])


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _find_near(means, log_sizes, opacities, view, constants, pixel, found, counts):
    near, low_pass, min_alpha = constants[0], constants[1], constants[2]
    fx, fy, cx, cy = view[12], view[13], view[14], view[15]
    one, two = np.float32(1), np.float32(2)
    slope_x, slope_y = max(-view[18], view[19]), max(-view[20], view[21])
    stretch = fx * fx * (one + slope_x * slope_x) + fy * fy * (one + slope_y * slope_y)
    largest = two * np.log(one / min_alpha)
    for chunk in numba.prange(len(counts)):
        start, kept = chunk * _CHUNK, 0
        for i in range(start, min(start + _CHUNK, len(means))):
            mx, my, mz = means[i, 0], means[i, 1], means[i, 2]
            z = view[6] * mx + view[7] * my + view[8] * mz + view[11]
            if not (z > near and opacities[i] >= min_alpha):
                continue
            rz = one / z
            dx = fx * rz * (view[0] * mx + view[1] * my + view[2] * mz + view[9]) + cx - pixel[0]
            dy = fy * rz * (view[3] * mx + view[4] * my + view[5] * mz + view[10]) + cy - pixel[1]
            largest_log = log_sizes[i, 0]
            for axis in range(1, log_sizes.shape[1]):
                largest_log = max(largest_log, log_sizes[i, axis])
            size = np.exp(largest_log) * rz
            if dx * dx + dy * dy <= np.float32(1.01) * largest * (stretch * size * size + low_pass):
                found[start + kept] = i
                kept += 1
        counts[chunk] = kept


@numba.njit(cache=True, error_model="numpy")
def _alphas_at(splats, left, top, column, line, constants, alphas):
    """α′ of projected splats at one pixel of the tile at (left, top), in the arithmetic of the blending loops."""
    min_alpha, max_alpha = constants[2], constants[3]
    for v in range(len(splats)):
        x, y, base, xx, xy, yy = compute_exponent(splats, v, left, top, min_alpha)
        dx, dy = np.float32(column) - x, np.float32(line) - y
        exponent = base + yy * dy * dy + dx * (xy * dy + xx * dx)
        if exponent >= FLOOR:
            alpha = power_of_two(exponent)
            alphas[v] = min(alpha, max_alpha) if alpha >= min_alpha else np.float32(0)
