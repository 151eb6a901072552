"""Casting rays into Gaussians: splats are binned into tiles of directions, each ray walks its tile's splats.

Along a ray x(t) = o + t d a Gaussian is largest at t* = (M(μ - o))·(M d) / |M d|², where M = S⁻¹ Rᵀ, and its opacity
there is α exp(-p²/2) with p = |M(μ - o) × M d| / |M d|. The return is where the splats around the median depth, the t*
at which what is left of the light falls below a half, are on average, each weighted by the light that it takes away:
a single splat lies farther off the surface than several do together.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64
from numpy import ndarray

LEAST_ALPHA, MOST_ALPHA = 0.01, 0.99
"""Fainter splats are passed over; no splat is denser."""
SQUARED_REACH = 9.2
"""2 ln(1 / `LEAST_ALPHA`): squared standard deviations at which an opaque splat becomes that faint."""
HELD = 64
"""Splats on a ray that are kept in order."""
AT_ONCE = 32
"""Splats that are looked at together."""
BEHIND = 0.5
"""Metres behind the return up to which centres of splats are looked at: one that lies aslant may be met before it."""
WINDOW = 0.3
"""Metres before and behind the median depth from which splats count for the return."""


@numba.njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def whiten(quats: ndarray, log_scales: ndarray) -> Float32[ndarray, "n 3 3"]:
    """Compute M = S⁻¹ Rᵀ of each splat, from unit quaternions w x y z."""
    matrices = np.empty((len(quats), 3, 3), np.float32)
    for i in numba.prange(len(quats)):
        w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        a, b, c = np.exp(-log_scales[i, 0]), np.exp(-log_scales[i, 1]), np.exp(-log_scales[i, 2])
        matrices[i, 0, 0] = a * (1 - 2 * (y * y + z * z))
        matrices[i, 0, 1] = a * (2 * (x * y + w * z))
        matrices[i, 0, 2] = a * (2 * (x * z - w * y))
        matrices[i, 1, 0] = b * (2 * (x * y - w * z))
        matrices[i, 1, 1] = b * (1 - 2 * (x * x + z * z))
        matrices[i, 1, 2] = b * (2 * (y * z + w * x))
        matrices[i, 2, 0] = c * (2 * (x * z + w * y))
        matrices[i, 2, 1] = c * (2 * (y * z - w * x))
        matrices[i, 2, 2] = c * (1 - 2 * (x * x + y * y))
    return matrices


@numba.njit(cache=True, parallel=True, error_model="numpy")
def find_tile_ranges(
    centers: Float32[ndarray, "n 3"],
    middle: Float32[ndarray, "3"],
    reaches: Float32[ndarray, " n"],
    used: Bool[ndarray, " k"],
    far: float,
    lowest: float,
    side: float,
    rows: int,
    columns: int,
) -> tuple[Int32[ndarray, "n 4"], Float32[ndarray, " n"]]:
    """Find the tiles that a sphere around each centre covers: first and last row, first column, count of columns.

    The second result are the distances of the centres from the middle, metres.

    Args:
        centers: of splats, in the sensor's axes, metres.
        middle: from where tiles are seen.
        reaches: radii of the spheres, metres; those below 0 are passed over.
        used: tiles through which rays look, row-major; a splat that covers none of them has a count of columns of 0.
        far: spheres that begin beyond are passed over; their count of columns is 0.
        lowest: elevation at which row 0 begins, radians.
        side: height and width of a tile, radians.
        rows: rows of tiles.
        columns: columns of tiles all around; column 0 begins at azimuth -π.
    """
    found, distances = np.zeros((len(centers), 4), np.int32), np.empty(len(centers), np.float32)
    for i in numba.prange(len(centers)):
        x, y, z, reach = centers[i, 0] - middle[0], centers[i, 1] - middle[1], centers[i, 2] - middle[2], reaches[i]
        distance = np.sqrt(x * x + y * y + z * z)
        distances[i] = distance
        if reach < 0 or not distance - reach < far:
            continue
        half = np.pi if distance <= reach else np.arcsin(reach / distance)
        elevation = np.arcsin(z / max(distance, 1e-6))
        first, last = (
            int(np.floor((elevation - half - lowest) / side)),
            int(np.floor((elevation + half - lowest) / side)),
        )
        first, last = max(first, 0), min(last, rows - 1)
        if last < first:
            continue
        across = np.pi
        if abs(elevation) + half < 0.5 * np.pi - 1e-3:
            across = np.arcsin(min(np.sin(half) / np.cos(elevation), 1.0))
        azimuth = np.arctan2(y, x) + np.pi
        start = int(np.floor((azimuth - across) / side))
        count = min(int(np.floor((azimuth + across) / side)) - start + 1, columns)
        if _covers_used(first, last, start % columns, count, used, columns):
            found[i, 0], found[i, 1], found[i, 2], found[i, 3] = first, last, start % columns, count
    return found, distances


@numba.njit(cache=True)
def _covers_used(first: int, last: int, start: int, count: int, used: ndarray, columns: int) -> bool:
    for row in range(first, last + 1):
        for step in range(count):
            if used[row * columns + (start + step) % columns]:
                return True
    return False


@numba.njit(cache=True)
def fill_tiles(
    order: Int64[ndarray, " n"], ranges: Int32[ndarray, "n 4"], used: ndarray, columns: int
) -> tuple[Int64[ndarray, " k"], Int32[ndarray, " m"]]:
    """List the splats of each tile in an order: where each tile's list begins, and the lists one after the other.

    Tiles that no ray looks through (`used`, row-major) stay empty.
    """
    starts = np.zeros(len(used) + 1, np.int64)
    for i in order:
        for row in range(ranges[i, 0], ranges[i, 1] + 1):
            for step in range(ranges[i, 3]):
                tile = row * columns + (ranges[i, 2] + step) % columns
                if used[tile]:
                    starts[tile + 1] += 1
    for tile in range(len(used)):
        starts[tile + 1] += starts[tile]
    lists, filled = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for i in order:
        for row in range(ranges[i, 0], ranges[i, 1] + 1):
            for step in range(ranges[i, 3]):
                tile = row * columns + (ranges[i, 2] + step) % columns
                if used[tile]:
                    lists[filled[tile]] = i
                    filled[tile] += 1
    return starts, lists


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
    """
    for tile in numba.prange(len(ray_starts) - 1):
        depths, weights = np.empty(HELD, np.float32), np.empty(HELD, np.float32)
        rows = np.empty(HELD, np.int32)
        listed = lists[starts[tile] : starts[tile + 1]]
        packed, filled = np.empty((15, len(listed)), np.float32), 0
        for position in range(ray_starts[tile], ray_starts[tile + 1]):
            ray = rays[position]
            held, filled = _meet(
                origins[ray], directions[ray], delays[ray], listed, means, matrices, alphas, offsets, distances,
                velocities, near, far, packed, filled, depths, weights, rows,
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


@numba.njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def list_meetings(
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
    depths: Float32[ndarray, "r h"],
    weights: Float32[ndarray, "r h"],
    rows: Int32[ndarray, "r h"],
) -> None:
    """List the splats that rays meet: the arguments of `walk_rays`, and what is written instead of ranges.

    Args:
        depths: written: metres, rising; shape (rays, `HELD`).
        weights: written: share of the light that each splat takes away; 0 where there is none.
        rows: written: the splats; -1 where there is none.
    """
    for tile in numba.prange(len(ray_starts) - 1):
        listed = lists[starts[tile] : starts[tile + 1]]
        packed, filled = np.empty((15, len(listed)), np.float32), 0
        for position in range(ray_starts[tile], ray_starts[tile + 1]):
            ray = rays[position]
            held, filled = _meet(
                origins[ray], directions[ray], delays[ray], listed, means, matrices, alphas, offsets, distances,
                velocities, near, far, packed, filled, depths[ray], weights[ray], rows[ray],
            )  # fmt: skip
            light = np.float32(1.0)
            for k in range(held):
                dimmed = light * (1 - weights[ray, k])
                weights[ray, k] *= light
                light = dimmed
            weights[ray, held:] = 0
            rows[ray, held:] = -1


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
    depths: ndarray,
    weights: ndarray,
    rows: ndarray,
) -> tuple[int, int]:
    """Write depth, opacity and row of the splats on a ray, near ones first.

    `packed` keeps what rays of a tile need of its first `filled` splats, value by value, so that a processor computes
    several at once. Returns how many splats there are, and how many are packed now.
    """
    dx, dy, dz = direction[0], direction[1], direction[2]
    held, left, end, median = 0, np.float32(1.0), np.float32(np.inf), np.float32(np.inf)
    off, along = np.empty(AT_ONCE, np.float32), np.empty(AT_ONCE, np.float32)
    for start in range(0, len(listed), AT_ONCE):
        if distances[listed[start]] > end:
            break
        stop = min(start + AT_ONCE, len(listed))
        if filled < stop:
            _pack(listed, start, stop, means, matrices, velocities, packed)
            filled = stop
        for k in range(start, stop):
            vx = packed[0, k] + packed[12, k] * delay - origin[0]
            vy = packed[1, k] + packed[13, k] * delay - origin[1]
            vz = packed[2, k] + packed[14, k] * delay - origin[2]
            gx = packed[3, k] * vx + packed[4, k] * vy + packed[5, k] * vz
            gy = packed[6, k] * vx + packed[7, k] * vy + packed[8, k] * vz
            gz = packed[9, k] * vx + packed[10, k] * vy + packed[11, k] * vz
            ex = packed[3, k] * dx + packed[4, k] * dy + packed[5, k] * dz
            ey = packed[6, k] * dx + packed[7, k] * dy + packed[8, k] * dz
            ez = packed[9, k] * dx + packed[10, k] * dy + packed[11, k] * dz
            squared = np.float32(1.0) / (ex * ex + ey * ey + ez * ez)
            cx, cy, cz = gy * ez - gz * ey, gz * ex - gx * ez, gx * ey - gy * ex
            off[k - start] = (cx * cx + cy * cy + cz * cz) * squared
            along[k - start] = (gx * ex + gy * ey + gz * ez) * squared
        for k in range(start, stop):
            if not off[k - start] < SQUARED_REACH:
                continue
            i = listed[k]
            alpha = min(alphas[i] * np.exp(np.float32(-0.5) * off[k - start]), np.float32(MOST_ALPHA))
            depth = along[k - start] + offsets[i]
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
def _pack(
    listed: ndarray, start: int, stop: int, means: ndarray, matrices: ndarray, velocities: ndarray, packed: ndarray
) -> None:
    moving = len(velocities) > 0
    for k in range(start, stop):
        i = listed[k]
        for axis in range(3):
            packed[axis, k] = means[i, axis]
            for other in range(3):
                packed[3 + 3 * axis + other, k] = matrices[i, axis, other]
            packed[12 + axis, k] = velocities[i, axis] if moving else np.float32(0.0)
