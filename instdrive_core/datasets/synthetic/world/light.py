"""Sun, sky and the kernels that turn hits into light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numba import njit
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.materials import CAR_GLASS, LAMP, LEAF, WINDOW
from instdrive_core.datasets.synthetic.world.textures import albedo, noise

SIDE = 2
SUBSAMPLES = SIDE * SIDE
"""Rays per pixel."""
SUN_RADIUS = 0.012
"""Half-width of the sun in radians; larger than the true one, for soft shadow borders."""


@dataclass(frozen=True)
class Light:
    """Sun and sky of a clip, in the street's frame."""

    to_sun: Float64[ndarray, "3"]
    """Unit vector."""
    cloud_seed: float
    haze: float = 0.0009
    """Share of light lost per metre."""

    def sun_directions(self) -> Float32[ndarray, "s 3"]:
        """One direction to the sun per subsample: together they cover its disc."""
        side = np.cross(self.to_sun, [0.0, 0, 1])
        side /= np.linalg.norm(side)
        up = np.cross(side, self.to_sun)
        angles = 2 * np.pi * (np.arange(SUBSAMPLES) + 0.3) / SUBSAMPLES
        directions = self.to_sun + SUN_RADIUS * (np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * up)
        return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def compute_sky_color(x, y, z, sx, sy, sz, seed):
    """Radiance of the sky (r, g, b) in unit direction (x, y, z): gradient, clouds, glow around the sun."""
    height = max(z, 0.0)
    pale = math.exp(-4.5 * height)
    r, g, b = 0.20 + 0.55 * pale, 0.40 + 0.42 * pale, 0.82 + 0.10 * pale
    reach = 1.0 / (height + 0.12)
    u, v = x * reach * 0.8 + seed, y * reach * 0.8
    cloud = 0.5 * noise(u, v, seed) + 0.28 * noise(2.1 * u, 2.1 * v, seed) + 0.22 * noise(4.7 * u, 4.7 * v, 3.0)
    cloud = min(1.0, max(0.0, (cloud - 0.5) * 4.0)) * min(1.0, height * 7)
    r, g, b = r + cloud * (0.95 - r), g + cloud * (0.96 - g), b + cloud * (0.98 - b)
    towards = max(0.0, x * sx + y * sy + z * sz)
    glow = 0.35 * towards**24 + 0.12 * towards**4
    return r + glow, g + 0.92 * glow, b + 0.75 * glow


@njit(cache=True, nogil=True, error_model="numpy")
def compute_hit_geometry(rows, triangles, distances, origin, directions, corners, points, normals):
    """Position and viewer-facing flat normal of each hit; `rows` are the rays that hit something."""
    for k in range(len(rows)):
        ray = rows[k]
        c = corners[triangles[ray]]
        ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
        bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        if nx * dx + ny * dy + nz * dz > 0:
            scale = -scale
        nx, ny, nz = nx * scale, ny * scale, nz * scale
        t = distances[ray]
        lift = 0.002 + 1e-4 * t
        normals[k, 0], normals[k, 1], normals[k, 2] = nx, ny, nz
        points[k, 0] = origin[0] + t * dx + lift * nx
        points[k, 1] = origin[1] + t * dy + lift * ny
        points[k, 2] = origin[2] + t * dz + lift * nz


@njit(cache=True, nogil=True, error_model="numpy")
def compute_probe_directions(rows, normals, sun, to_light, to_open):
    """Per hit the direction to the sun's part of its subsample, and one of the subsamples' directions around the
    normal, along which ambient light is tested."""
    for k in range(len(rows)):
        part = rows[k] % SUBSAMPLES
        to_light[k, 0], to_light[k, 1], to_light[k, 2] = sun[part, 0], sun[part, 1], sun[part, 2]
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        sign = 1.0 if nz >= 0 else -1.0  # tangent frame of Duff et al. 2017
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        angle = 2 * math.pi * (part + 0.15) / SUBSAMPLES
        c, s = 0.75 * math.cos(angle), 0.75 * math.sin(angle)
        to_open[k, 0] = 0.66 * nx + c * (1 + sign * nx * nx * a) + s * b
        to_open[k, 1] = 0.66 * ny + c * sign * b + s * (sign + ny * ny * a)
        to_open[k, 2] = 0.66 * nz + c * (-sign * nx) + s * (-ny)


@njit(cache=True, nogil=True, error_model="numpy")
def shade_hits(
    rows, triangles, us, vs, distances, directions, flat_normals, texcoords, normals, materials, table,
    in_shadow, enclosed, to_sun, cloud_seed, haze, pixel_angle, radiance,
):  # fmt: skip
    """Writes the radiance that each hit sends to the viewer into `radiance` (rays, 3)."""
    sx, sy, sz = to_sun[0], to_sun[1], to_sun[2]
    for k in range(len(rows)):
        ray = rows[k]
        triangle = triangles[ray]
        u, v, t = us[ray], vs[ray], distances[ray]
        w = 1 - u - v
        texture, corner_normals, m = texcoords[triangle], normals[triangle], table[materials[triangle]]
        x = w * texture[0, 0] + u * texture[1, 0] + v * texture[2, 0]
        y = w * texture[0, 1] + u * texture[1, 1] + v * texture[2, 1]
        z = w * texture[0, 2] + u * texture[1, 2] + v * texture[2, 2]
        nx = w * corner_normals[0, 0] + u * corner_normals[1, 0] + v * corner_normals[2, 0]
        ny = w * corner_normals[0, 1] + u * corner_normals[1, 1] + v * corner_normals[2, 1]
        nz = w * corner_normals[0, 2] + u * corner_normals[1, 2] + v * corner_normals[2, 2]
        scale = 1.0 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-6)
        fx, fy, fz = flat_normals[k, 0], flat_normals[k, 1], flat_normals[k, 2]
        if nx * fx + ny * fy + nz * fz < 0:
            scale = -scale
        nx, ny, nz = nx * scale, ny * scale, nz * scale
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        facing = max(0.02, -(dx * fx + dy * fy + dz * fz))
        footprint = 0.5 * t * pixel_angle / math.sqrt(facing)
        kind = int(m[0])
        r, g, b = albedo(kind, x, y, z, m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], footprint)

        sunlit = 0.0 if in_shadow[k] else max(0.0, nx * sx + ny * sy + nz * sz)
        if kind == LEAF:  # light shines through leaves
            sunlit = 0.7 * sunlit + (0.12 if in_shadow[k] else 0.3)
        open_share = 0.35 if enclosed[k] else 1.0
        up = 0.5 + 0.5 * nz
        red = r * (2.10 * sunlit + open_share * (0.27 + 0.20 * up))
        green = g * (1.90 * sunlit + open_share * (0.25 + 0.28 * up))
        blue = b * (1.58 * sunlit + open_share * (0.22 + 0.42 * up))

        gloss = m[9]
        if gloss > 0:
            cosine = -(dx * nx + dy * ny + dz * nz)
            mx, my, mz = dx + 2 * cosine * nx, dy + 2 * cosine * ny, dz + 2 * cosine * nz
            mirror = gloss * (0.15 + 0.85 * (1 - min(1.0, max(0.0, cosine))) ** 4)
            if mz < 0.12 and kind != CAR_GLASS and kind != WINDOW:
                mirror *= 0.4
            sr, sg, sb = compute_sky_color(mx, my, mz, sx, sy, sz, cloud_seed)
            skyline = min(1.0, max(0.0, (mz - 0.05) * 3.0))  # below it the mirror shows houses and road
            red = red * (1 - mirror) + mirror * (skyline * sr + (1 - skyline) * 0.16)
            green = green * (1 - mirror) + mirror * (skyline * sg + (1 - skyline) * 0.15)
            blue = blue * (1 - mirror) + mirror * (skyline * sb + (1 - skyline) * 0.14)
            spot = max(0.0, mx * sx + my * sy + mz * sz)
            if not in_shadow[k]:
                spot = 1.2 * gloss * spot**60
                red, green, blue = red + spot, green + spot, blue + spot
        if kind == LAMP:
            red, green, blue = red + 0.6 * r * m[8], green + 0.6 * g * m[8], blue + 0.6 * b * m[8]

        lost = 1 - math.exp(-haze * t)
        radiance[ray, 0] = red * (1 - lost) + lost * 0.72
        radiance[ray, 1] = green * (1 - lost) + lost * 0.79
        radiance[ray, 2] = blue * (1 - lost) + lost * 0.90


@njit(cache=True, nogil=True, error_model="numpy")
def shade_sky(triangles, directions, to_sun, cloud_seed, radiance):
    """Writes the sky's radiance for the rays that hit nothing."""
    for ray in range(len(triangles)):
        if triangles[ray] < 0:
            r, g, b = compute_sky_color(
                directions[ray, 0], directions[ray, 1], directions[ray, 2], to_sun[0], to_sun[1], to_sun[2], cloud_seed
            )
            radiance[ray, 0], radiance[ray, 1], radiance[ray, 2] = r, g, b


@njit(cache=True, nogil=True, error_model="numpy")
def develop_photo(radiance, ids, exposure, photo, labels):
    """Averages the subsamples of each pixel into an sRGB photo (n, 3) uint8, and takes the instance ID that most of
    them hit (n,) uint16; the first of equals wins."""
    for pixel in range(len(labels)):
        first = pixel * SUBSAMPLES
        for channel in range(3):
            total = 0.0
            for part in range(SUBSAMPLES):  # tone-mapped first, so that highlights do not eat borders
                value = exposure * radiance[first + part, channel]
                total += value * (2.51 * value + 0.03) / (value * (2.43 * value + 0.59) + 0.14)  # ACES fit, Narkowicz
            value = min(1.0, total / SUBSAMPLES)
            value = 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
            photo[pixel, channel] = int(255 * value + 0.5)
        best = 0
        for part in range(SUBSAMPLES):
            votes = 0
            for other in range(SUBSAMPLES):
                if ids[first + other] == ids[first + part]:
                    votes += 1
            if votes > best:
                best = votes
                labels[pixel] = ids[first + part]
