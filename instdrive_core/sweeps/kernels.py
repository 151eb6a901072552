"""Casting rays into Gaussians: each ray walks the splats of the tile of directions that it looks through.

Along a ray x(t) = o + t d a Gaussian is largest at t* = (M(μ - o))·(M d) / |M d|², where M = S⁻¹ Rᵀ, and its opacity
there is α exp(-p²/2) with p = |M(μ - o) × M d| / |M d|. The return is where the splats around the median depth, the t*
at which what is left of the light falls below a half, are on average, each weighted by the light that it takes away:
a single splat lies farther off the surface than several do together.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.simd import find_lowest_bit, load, pack_lane_bits, store

LEAST_ALPHA, MOST_ALPHA = 0.01, 0.99
"""Fainter splats are passed over; no splat is denser."""
SQUARED_REACH = 9.2
"""2 ln(1 / `LEAST_ALPHA`): squared standard deviations at which an opaque splat becomes that faint."""
HELD = 64
"""Splats on a ray that are kept in order."""
BEHIND = 0.5
"""Metres behind the return up to which centres of splats are looked at: one that lies aslant may be met before it."""
WINDOW = 0.3
"""Metres before and behind the median depth from which splats count for the return."""
_AT_ONCE = 16
"""Splats that are looked at together: as many as a vector has lanes."""
_KEPT = 15
"""Values that rays need of a splat: its mean, the rows of M, its velocity."""
# Places are uint64: for other numbers Numba asks whether they count from the end.
_NONE, _ONE, _LANES, _BLOCK = np.uint64(0), np.uint64(1), np.uint64(_AT_ONCE), np.uint64(_AT_ONCE * _KEPT)
_AT = tuple(np.uint64(_AT_ONCE * kind) for kind in range(_KEPT))
"""Where a block has the values of each kind."""


@numba.njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def walk_rays(
    ray_starts: Int64[ndarray, " k"],
    rays: Int64[ndarray, " r"],
    origins: Float32[ndarray, "r 3"],
    directions: Float32[ndarray, "r 3"],
    delays: Float32[ndarray, " r"],
    starts: Int64[ndarray, " k"],
    lists: Int32[ndarray, " m"],
    means: Float32[ndarray, "n 3"],
    matrices: Float32[ndarray, "n 3 3"],
    alphas: Float32[ndarray, " n"],
    offsets: Float32[ndarray, " n"],
    distances: Float32[ndarray, " n"],
    velocities: Float32[ndarray, "n 3"],
    near: float,
    far: float,
    ranges: Float32[ndarray, " r"],
    hits: Int32[ndarray, " r"],
    opacities: Float32[ndarray, " r"],
    met_depths: Float32[ndarray, "s h"],
    met_weights: Float32[ndarray, "s h"],
    met_rows: Int32[ndarray, "s h"],
) -> None:
    """Walk all rays through the splats of their tiles and write range, splat and opacity of each.

    Args:
        ray_starts: where each tile's rays begin in `rays`.
        rays: numbers of rays, tile by tile.
        origins: of the rays, in the frame of `means`.
        directions: unit vectors.
        delays: seconds from the moment at which `means` are right.
        starts: where each tile's list begins in `lists`.
        lists: splats of the tiles, near ones first.
        means: of the splats, metres.
        matrices: of `whiten`.
        alphas: opacities of the splats.
        offsets: metres along a ray from where each splat is densest to the surface that it stands for.
        distances: of the splats' centres from the middle of the origins.
        velocities: of the splats, m/s; shape (0, 3) where nothing moves.
        near: metres before which splats are passed over.
        far: metres behind which nothing returns.
        ranges: written: metres, infinite where nothing returns.
        hits: written: the splat at which half the light is gone, -1 where it never is.
        opacities: written: the share of light that splats take away up to `far`, or up to where the walk ended.
        met_depths: written: metres of the splats that each ray meets, rising; shape (rays, `HELD`), or (0, `HELD`)
            where nobody wants to know.
        met_weights: written likewise: share of the light that each takes away; 0 where there is none.
        met_rows: written likewise: the splats; -1 where there is none.
    """
    for tile in numba.prange(len(ray_starts) - 1):
        if ray_starts[tile] == ray_starts[tile + 1]:
            continue
        depths, weights = np.empty(HELD, np.float32), np.empty(HELD, np.float32)
        rows = np.empty(HELD, np.int32)
        listed = lists[starts[tile] : starts[tile + 1]]
        blocks = (len(listed) + _AT_ONCE - 1) // _AT_ONCE
        packed, filled = np.empty(blocks * _AT_ONCE * _KEPT, np.float32), 0
        beside = np.empty(2 * _AT_ONCE, np.float32)
        for position in range(ray_starts[tile], ray_starts[tile + 1]):
            ray = rays[position]
            held, filled = _meet(
                origins[ray], directions[ray], delays[ray], listed, means, matrices, alphas, offsets, distances,
                velocities, near, far, packed, filled, beside, depths, weights, rows,
            )  # fmt: skip
            light, found, depth = np.float32(1.0), -1, np.float32(0.0)
            for k in range(held):
                dimmed = light * (1 - weights[k])
                if found < 0 and dimmed < 0.5:
                    found, depth = k, depths[k]
                    if k and (light - 0.5) < (0.5 - dimmed):  # nearer to the splat before, by the light that is gone
                        depth = depths[k - 1]
                weights[k] *= light
                light = dimmed
            opacities[ray] = 1 - light
            if found >= 0:
                total, mean = np.float32(0.0), np.float32(0.0)
                for k in range(held):
                    if abs(depths[k] - depth) <= WINDOW:
                        total += weights[k]
                        mean += weights[k] * (depths[k] - depth)
                ranges[ray], hits[ray] = depth + mean / total, rows[found]
            if len(met_depths):
                for k in range(held):
                    met_depths[ray, k], met_weights[ray, k], met_rows[ray, k] = depths[k], weights[k], rows[k]
                met_weights[ray, held:] = 0
                met_rows[ray, held:] = -1


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _meet(
    origin: ndarray,
    direction: ndarray,
    delay: ndarray | float,
    listed: ndarray,
    means: ndarray,
    matrices: ndarray,
    alphas: ndarray,
    offsets: ndarray,
    distances: ndarray,
    velocities: ndarray,
    near: float,
    far: float,
    packed: ndarray,
    filled: int,
    beside: ndarray,
    depths: ndarray,
    weights: ndarray,
    rows: ndarray,
) -> tuple[int, int]:
    """Write depth, opacity and row of the splats on a ray, near ones first.

    `packed` keeps what rays of a tile need of its first `filled` splats, value by value, so that a processor computes
    several at once. Returns how many splats there are, and how many are packed now.
    """
    ox, oy, oz = origin[0], origin[1], origin[2]
    dx, dy, dz = direction[0], direction[1], direction[2]
    held, left, end, median = 0, np.float32(1.0), np.float32(np.inf), np.float32(np.inf)
    at = _NONE
    for start in range(0, len(listed), _AT_ONCE):
        if distances[listed[start]] > end:
            break
        count = min(_AT_ONCE, len(listed) - start)
        if filled <= start:
            _pack(listed[start : start + count], means, matrices, velocities, packed[start * _KEPT :])
            filled = start + count
        vx = load(packed, at + _AT[0]) + delay * load(packed, at + _AT[12]) - ox
        vy = load(packed, at + _AT[1]) + delay * load(packed, at + _AT[13]) - oy
        vz = load(packed, at + _AT[2]) + delay * load(packed, at + _AT[14]) - oz
        xx, xy, xz = load(packed, at + _AT[3]), load(packed, at + _AT[4]), load(packed, at + _AT[5])
        yx, yy, yz = load(packed, at + _AT[6]), load(packed, at + _AT[7]), load(packed, at + _AT[8])
        zx, zy, zz = load(packed, at + _AT[9]), load(packed, at + _AT[10]), load(packed, at + _AT[11])
        gx, gy, gz = xx * vx + xy * vy + xz * vz, yx * vx + yy * vy + yz * vz, zx * vx + zy * vy + zz * vz
        ex, ey, ez = xx * dx + xy * dy + xz * dz, yx * dx + yy * dy + yz * dz, zx * dx + zy * dy + zz * dz
        length = ex * ex + ey * ey + ez * ez
        cx, cy, cz = gy * ez - gz * ey, gz * ex - gx * ez, gx * ey - gy * ex
        aside = cx * cx + cy * cy + cz * cz
        at += _BLOCK
        met = np.uint64(pack_lane_bits(aside <= np.float32(SQUARED_REACH) * length)) & (
            (_ONE << np.uint64(count)) - _ONE
        )
        if met == _NONE:
            continue
        store(beside, _NONE, aside / length)
        store(beside, _LANES, (gx * ex + gy * ey + gz * ez) / length)
        while met != _NONE:
            lane = find_lowest_bit(met)
            met &= met - _ONE
            i = listed[start + lane]
            alpha = min(alphas[i] * np.exp(np.float32(-0.5) * beside[lane]), np.float32(MOST_ALPHA))
            depth = beside[_LANES + lane] + offsets[i]
            if alpha < LEAST_ALPHA or depth < near or depth > far or distances[i] > end:
                continue
            if held == HELD and depth >= depths[held - 1]:
                continue
            place = min(held, HELD - 1)
            while place > 0 and depths[place - 1] > depth:
                depths[place], weights[place], rows[place] = depths[place - 1], weights[place - 1], rows[place - 1]
                place -= 1
            depths[place], weights[place], rows[place] = depth, alpha, i
            held = min(held + 1, HELD)
            left *= 1 - alpha
            if left < 0.5 and depth < median:  # one behind the median changes nothing
                light = np.float32(1.0)
                for each in range(held):
                    light *= 1 - weights[each]
                    if light < 0.5:
                        median = depths[each]
                        end = median + np.float32(BEHIND)
                        break
    return held, filled


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _pack(listed: ndarray, means: ndarray, matrices: ndarray, velocities: ndarray, packed: ndarray) -> None:
    """Write the values of up to `_AT_ONCE` splats, kind by kind; what is missing of a block gets those of the first."""
    moving = len(velocities) > 0
    for k in range(_AT_ONCE):
        i = listed[k if k < len(listed) else 0]
        for axis in range(3):
            packed[axis * _AT_ONCE + k] = means[i, axis]
            for other in range(3):
                packed[(3 + 3 * axis + other) * _AT_ONCE + k] = matrices[i, axis, other]
            packed[(12 + axis) * _AT_ONCE + k] = velocities[i, axis] if moving else np.float32(0.0)
