"""Casting rays into Gaussians: splats are binned into tiles of directions, each ray walks its tile's splats.

Along a ray x(t) = o + t d a Gaussian is largest at t* = (M(μ - o))·(M d) / |M d|², where M = S⁻¹ Rᵀ, and its opacity
there is α exp(-p²/2) with p = |M(μ - o) × M d| / |M d|. The return is the median depth: the t* at which what is left of
the light falls below a half.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

LEAST_ALPHA, MOST_ALPHA = 0.01, 0.99
"""Fainter splats are passed over; no splat is denser."""
SQUARED_REACH = 9.2
"""2 ln(1 / `LEAST_ALPHA`): squared standard deviations at which an opaque splat becomes that faint."""
HELD = 64
"""Splats on a ray that are kept in order."""
BEHIND = 0.5
"""Metres behind the return up to which centres of splats are looked at: one that lies aslant may be met before it."""


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
    reaches: Float32[ndarray, " n"],
    far: float,
    lowest: float,
    side: float,
    rows: int,
    columns: int,
) -> Int32[ndarray, "n 4"]:
    """Find the tiles that a sphere around each centre covers: first and last row, first column, count of columns.

    Args:
        centers: of splats, in the sensor's axes, metres.
        reaches: radii of the spheres, metres.
        far: spheres that begin beyond are passed over; their count of columns is 0.
        lowest: elevation at which row 0 begins, radians.
        side: height and width of a tile, radians.
        rows: rows of tiles.
        columns: columns of tiles all around; column 0 begins at azimuth -π.
    """
    found = np.zeros((len(centers), 4), np.int32)
    for i in numba.prange(len(centers)):
        x, y, z, reach = centers[i, 0], centers[i, 1], centers[i, 2], reaches[i]
        distance = np.sqrt(x * x + y * y + z * z)
        if not distance - reach < far:
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
        found[i, 0], found[i, 1], found[i, 2], found[i, 3] = first, last, start % columns, count
    return found


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
        distances: of the splats' centres from the middle of the origins.
        velocities: of the splats, m/s; shape (0, 3) where nothing moves.
        near: metres before which splats are passed over.
        far: metres behind which nothing returns.
        ranges: written: metres, infinite where nothing returns.
        hits: written: the splat at which half the light is gone, -1 where it never is.
        opacities: written: the share of light that splats take away up to `far`, or up to where the walk ended.
    """
    moving = len(velocities) > 0
    for tile in numba.prange(len(ray_starts) - 1):
        depths, weights = np.empty(HELD, np.float32), np.empty(HELD, np.float32)
        rows = np.empty(HELD, np.int32)
        for position in range(ray_starts[tile], ray_starts[tile + 1]):
            ray = rays[position]
            dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
            held, left, end = 0, np.float32(1.0), np.float32(np.inf)
            for entry in range(starts[tile], starts[tile + 1]):
                i = lists[entry]
                if distances[i] > end:
                    break
                vx, vy, vz = means[i, 0] - origins[ray, 0], means[i, 1] - origins[ray, 1], means[i, 2] - origins[ray, 2]
                if moving:
                    vx += velocities[i, 0] * delays[ray]
                    vy += velocities[i, 1] * delays[ray]
                    vz += velocities[i, 2] * delays[ray]
                gx = matrices[i, 0, 0] * vx + matrices[i, 0, 1] * vy + matrices[i, 0, 2] * vz
                gy = matrices[i, 1, 0] * vx + matrices[i, 1, 1] * vy + matrices[i, 1, 2] * vz
                gz = matrices[i, 2, 0] * vx + matrices[i, 2, 1] * vy + matrices[i, 2, 2] * vz
                ex = matrices[i, 0, 0] * dx + matrices[i, 0, 1] * dy + matrices[i, 0, 2] * dz
                ey = matrices[i, 1, 0] * dx + matrices[i, 1, 1] * dy + matrices[i, 1, 2] * dz
                ez = matrices[i, 2, 0] * dx + matrices[i, 2, 1] * dy + matrices[i, 2, 2] * dz
                squared = ex * ex + ey * ey + ez * ez
                cx, cy, cz = gy * ez - gz * ey, gz * ex - gx * ez, gx * ey - gy * ex
                off = (cx * cx + cy * cy + cz * cz) / squared
                if not off < SQUARED_REACH:
                    continue
                alpha = min(alphas[i] * np.exp(np.float32(-0.5) * off), np.float32(MOST_ALPHA))
                depth = (gx * ex + gy * ey + gz * ez) / squared
                if alpha < LEAST_ALPHA or depth < near or depth > far:
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
                if left < 0.5:
                    light = np.float32(1.0)
                    for k in range(held):
                        light *= 1 - weights[k]
                        if light < 0.5:
                            end = depths[k] + np.float32(BEHIND)
                            break
            light, found, depth = np.float32(1.0), -1, np.float32(0.0)
            for k in range(held):
                dimmed = light * (1 - weights[k])
                if found < 0 and dimmed < 0.5:
                    found, depth = k, depths[k]
                    if k:  # between this splat and the one before, by the light that is gone at each
                        depth -= (depths[k] - depths[k - 1]) * (np.float32(0.5) - dimmed) / (light - dimmed)
                light = dimmed
            opacities[ray] = 1 - light
            if found >= 0:
                ranges[ray], hits[ray] = depth, rows[found]
