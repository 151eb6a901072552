"""Procedural textures, evaluated at a point of an object's own frame.

Each returns a linear-light albedo. `footprint` is the width in metres that one sample covers: detail finer than that
fades into its mean, so that distant surfaces do not flicker from frame to frame.
"""

from __future__ import annotations

import math

from numba import njit

from instdrive_core.datasets.synthetic.world.materials import (
    ASPHALT,
    BARK,
    BRICK,
    CAR_PAINT,
    CLOTH,
    GRASS,
    LAMP,
    LEAF,
    PAINTED_LINE,
    PAVING,
    PLASTER,
    POSTER,
    RIM,
    ROOF,
    SHUTTER,
    SIGN,
    STRIPES,
    WINDOW,
    WOOD,
)


@njit(cache=True, nogil=True, error_model="numpy")
def hash_cell(x, y, z):
    """Turn three integers into a number in [0, 1) that shows no pattern."""
    h = (x * 73856093 ^ y * 19349663 ^ z * 83492791) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 739982445) & 0xFFFFFFFF
    h = ((h ^ (h >> 12)) * 695872825) & 0xFFFFFFFF
    h ^= h >> 15
    return h * (1.0 / 4294967296.0)


@njit(cache=True, nogil=True, error_model="numpy")
def noise(x, y, z):
    """Value noise in [0, 1] with unit period."""
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    ix, iy, iz = int(fx), int(fy), int(fz)
    x, y, z = x - fx, y - fy, z - fz
    x, y, z = x * x * (3 - 2 * x), y * y * (3 - 2 * y), z * z * (3 - 2 * z)
    a = hash_cell(ix, iy, iz) * (1 - x) + hash_cell(ix + 1, iy, iz) * x
    b = hash_cell(ix, iy + 1, iz) * (1 - x) + hash_cell(ix + 1, iy + 1, iz) * x
    c = hash_cell(ix, iy, iz + 1) * (1 - x) + hash_cell(ix + 1, iy, iz + 1) * x
    d = hash_cell(ix, iy + 1, iz + 1) * (1 - x) + hash_cell(ix + 1, iy + 1, iz + 1) * x
    return (a * (1 - y) + b * y) * (1 - z) + (c * (1 - y) + d * y) * z


@njit(cache=True, nogil=True, error_model="numpy")
def compute_sharpness(period, footprint):
    """1 where detail of `period` metres is resolved, 0 where it is finer than the footprint."""
    return min(1.0, max(0.0, 1.5 - 2.0 * footprint / period))


@njit(cache=True, nogil=True, error_model="numpy")
def grain(x, y, z, period, footprint):
    """Noise around 0, in [-0.5, 0.5], faded where it would alias."""
    visible = compute_sharpness(period, footprint)
    if visible <= 0:
        return 0.0
    return visible * (noise(x / period, y / period, z / period) - 0.5)


@njit(cache=True, nogil=True, error_model="numpy")
def joints(s, t, width, footprint):
    """Coverage of joints of `width` metres between unit-free cells: s and t are metres to the nearest joint."""
    nearest = min(s, t)
    blur = max(footprint, 0.2 * width)
    return min(1.0, max(0.0, (0.5 * width - nearest) / blur + 0.5))


@njit(cache=True, nogil=True, error_model="numpy")
def asphalt(x, y, z, footprint):
    """Brightness of worn asphalt: patches, wheel tracks, grain and cracks."""
    tone = 1.0 + 0.35 * grain(x, y, z, 5.0, footprint) + 0.22 * grain(x, y + 40, z, 0.9, footprint)
    tone += 0.3 * grain(x, y, z, 0.16, footprint) + 0.3 * grain(x, y, z, 0.05, footprint)
    wander = 2.2 * grain(x + 70, y, 0.0, 3.0, footprint) + 0.7 * grain(x, y, 1.0, 0.6, footprint)
    crack = abs(noise(x * 0.22 + wander * 0.3, y * 0.22 - wander * 0.3, 5.0) - 0.5)
    if crack < 0.006:
        tone -= 0.45 * (1 - crack / 0.006) * compute_sharpness(0.08, footprint)
    return tone


@njit(cache=True, nogil=True, error_model="numpy")
def cell_pattern(s, t, width, height, joint, shifted, footprint):
    """Rows of cells (bricks, slabs, tiles): (coverage of joints, tone of the cell in [-0.5, 0.5])."""
    row = math.floor(t / height)
    if shifted:
        s += 0.5 * width * (int(row) % 2)
    column = math.floor(s / width)
    ds, dt = s - column * width, t - row * height
    coverage = joints(min(ds, width - ds), min(dt, height - dt), joint, footprint)
    visible = compute_sharpness(height, footprint)
    mean = 2 * joint * (width + height) / (width * height) * 0.5
    tone = (hash_cell(int(column), int(row), 17) - 0.5) * visible
    return coverage * visible + mean * (1 - visible), tone


@njit(cache=True, nogil=True, error_model="numpy")
def window(s, t, seed, size, footprint):
    """(coverage of the frame, brightness behind the glass) of a window with its corner at 0; `size` is its width."""
    column, row = abs(s - 0.5 * size), t - 1.0
    frame = 0.0
    blur = max(footprint, 0.01)
    edge = min(min(s, size - s), min(t, column + 1.0))
    frame = max(frame, min(1.0, max(0.0, (0.07 - edge) / blur)))
    if size > 0.8:
        frame = max(frame, min(1.0, max(0.0, (0.03 - column) / blur)))
    if size < 2.2:
        frame = max(frame, min(1.0, max(0.0, (0.03 - abs(row)) / blur)))
    chance = hash_cell(seed, 3, 1)
    behind = 0.05 + 0.05 * hash_cell(seed, 5, 2)
    if chance < 0.45:  # curtains on both sides, or a blind from above
        if chance < 0.3:
            drawn = 0.12 + 0.25 * hash_cell(seed, 7, 3)
            if column > size * (0.5 - drawn):
                behind = 0.38 + 0.1 * math.sin(s * 45.0) * compute_sharpness(0.14, footprint)
        elif t > 0.5 + hash_cell(seed, 9, 4):
            behind = 0.34
    return frame, behind


@njit(cache=True, nogil=True, error_model="numpy")
def sign_face(s, t, variant):
    """Colour that a sign's face has at (s, t) in [-1, 1]²: 0 = ground, 1 = second colour, 2 = white, 3 = dark."""
    radius = math.sqrt(s * s + t * t)
    if variant < 1:  # speed limit: red ring, dark digits on white
        if radius > 0.72:
            return 0
        digit = abs(abs(s) - 0.28) < 0.2 and abs(t) < 0.36
        hole = abs(abs(s) - 0.28) < 0.09 and abs(t) < 0.24
        return 3 if digit and not hole else 2
    if variant < 2:  # parking: white P on blue
        stem = abs(s + 0.25) < 0.11 and abs(t) < 0.62
        bow = math.sqrt((s + 0.1) ** 2 + (t - 0.27) ** 2)
        return 2 if stem or (0.2 < bow < 0.4 and s > -0.2) else 0
    if variant < 3:  # no stopping: red ring and bar on blue
        if radius > 0.78 or abs(s + t) < 0.2:
            return 1
        return 0
    if variant < 4:  # crossing: white triangle with a walking figure on blue
        if t > -0.62 and abs(s) < 0.62 - 0.5 * (t + 0.62) * 0.9:
            figure = abs(s) < 0.09 and -0.5 < t < 0.2
            legs = abs(abs(s) - 0.14 - 0.3 * t) < 0.06 and -0.55 < t < -0.1
            return 3 if figure or legs else 2
        return 0
    return 2 if abs(t) < 0.12 and abs(s) < 0.7 else 0  # no entry: white bar on red


@njit(cache=True, nogil=True, error_model="numpy")
def albedo(kind, x, y, z, r, g, b, r2, g2, b2, size, variant, footprint):
    """Linear-light albedo (r, g, b) of a material at texture coordinates (x, y, z)."""
    tone, other = 1.0, 0.0  # brightness of the first colour, share of the second one
    if kind == ASPHALT:
        tone = asphalt(x, y, z, footprint)
    elif kind == PAVING:
        other, slab = cell_pattern(x, y, size, size, 0.02, False, footprint)
        tone = 1 + 0.2 * slab + 0.25 * grain(x, y, z, 2.5, footprint) + 0.15 * grain(x, y, z, 0.12, footprint)
    elif kind == BRICK:
        other, brick = cell_pattern(x, y, 0.26, 0.085, 0.014, True, footprint)
        tone = 1 + 0.5 * brick + 0.3 * grain(x, y, z, 3.0, footprint) + 0.2 * grain(x, y, z, 0.5, footprint)
    elif kind == PLASTER:
        tone = 1 + 0.12 * grain(x, y, z, 0.06, footprint) + 0.2 * grain(x, y, z, 2.2, footprint)
        tone += 0.22 * grain(x * 4, y * 0.5, z * 4, 1.2, footprint)
        tone -= 0.25 * max(0.0, 1 - y / 0.7) * noise(x * 1.3, y * 2, z)
    elif kind == WINDOW:
        frame, behind = window(x, y, int(z + 0.5), size, footprint)
        return (
            frame * r2 + (1 - frame) * behind * r,
            frame * g2 + (1 - frame) * behind * g,
            frame * b2 + (1 - frame) * behind * b,
        )
    elif kind == ROOF:
        other, tile = cell_pattern(x, y, 0.3, 0.34, 0.04, True, footprint)
        tone = 1 + 0.4 * tile + 0.3 * grain(x, y, z, 2.0, footprint)
    elif kind == LEAF:
        tone = 1 + 0.5 * grain(x, y, z, 0.9, footprint) + 0.55 * grain(x, y, z, 0.22, footprint)
        other = 0.5 + grain(x + 9, y, z, 1.7, footprint)
    elif kind == BARK:
        tone = 1 + 0.5 * grain(x * 5, y * 5, z, 0.4, footprint) + 0.3 * grain(x, y, z, 0.08, footprint)
    elif kind == GRASS:
        tone = 1 + 0.35 * grain(x, y, z, 0.11, footprint) + 0.3 * grain(x, y, z, 0.8, footprint)
        other = min(1.0, max(0.0, 0.4 + 1.6 * grain(x, y, z, 4.0, footprint)))
    elif kind == PAINTED_LINE:
        worn = noise(x * 7, y * 7, z) * 0.6 + noise(x * 23, y * 23, z) * 0.4
        other = 0.75 * min(1.0, max(0.0, (worn - 0.56) * 6)) * compute_sharpness(0.12, footprint) + 0.1
    elif kind == CAR_PAINT:
        tone = 1 + 0.1 * grain(x, y, z, 0.5, footprint)
        other = 0.45 * max(0.0, 1 - (z - size) / 0.35) * noise(x * 3, y * 3, z * 3)  # dust from the road
    elif kind == RIM:
        radius, angle = math.sqrt(x * x + y * y), math.atan2(y, x)
        spoke = math.cos(angle * variant)
        if radius > size or (radius > 0.3 * size and radius < 0.9 * size and spoke < -0.1):
            other = 1.0
    elif kind == LAMP:
        tone = 0.85 + 0.3 * math.sin(x * 60) * compute_sharpness(0.1, footprint)
    elif kind == SIGN:
        part = sign_face(x / size, y / size, variant)
        if part == 2:
            return 0.8, 0.8, 0.8
        if part == 3:
            return 0.03, 0.03, 0.03
        other = float(part)
    elif kind == SHUTTER:
        phase = y / size - math.floor(y / size)
        other = (1.0 if phase < 0.18 else 0.15 * phase) * compute_sharpness(size, footprint)
        tone = 1 + 0.15 * grain(x, y, z, 1.0, footprint)
    elif kind == STRIPES:
        phase = x / size - math.floor(x / size)
        other = 1.0 if phase < 0.5 else 0.0
    elif kind == WOOD:
        plank = math.floor(x / size)
        tone = 0.85 + 0.3 * hash_cell(int(plank), 4, 8) + 0.4 * grain(x * 6, y, z, 0.5, footprint)
        if x / size - plank < 0.06:
            tone *= 0.5
    elif kind == CLOTH:
        tone = 1 + 0.35 * grain(x, y, z, 0.14, footprint) + 0.15 * grain(x, y, z, 0.03, footprint)
        if variant > 0:
            other = 1.0 if z / 0.09 - math.floor(z / 0.09) < 0.5 else 0.0
    elif kind == POSTER:
        letter = hash_cell(math.floor(x / size), math.floor(y / (1.6 * size)), int(variant))
        inside = abs(y / (1.6 * size) - math.floor(y / (1.6 * size)) - 0.5) < 0.33
        gap = x / size - math.floor(x / size) > 0.25
        other = 1.0 if inside and gap and letter > 0.25 else 0.0
    else:
        tone = 1 + 0.12 * grain(x, y, z, 0.3, footprint)
    return (
        tone * r * (1 - other) + other * r2,
        tone * g * (1 - other) + other * g2,
        tone * b * (1 - other) + other * b2,
    )
