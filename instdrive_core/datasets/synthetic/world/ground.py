"""Road, markings, kerbs, pavements and lots of a straight street with one crossing.

The street's frame: x right, y along the street, z up, the road at z = 0. The crossing street runs along x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from instdrive_core.datasets.synthetic.world.materials import (
    ASPHALT,
    GRASS,
    PAINTED_LINE,
    PAVING,
    PLAIN,
    Material,
    MaterialPalette,
)
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import build_box, build_disc, build_floor, build_quad

ROAD_HALF = 5.6
"""Two lanes and two parking strips."""
LANE = 1.65
"""Distance of a lane's middle from the centre line."""
PARKING = 4.55
"""Distance of a parked car's middle from the centre line."""
CROSS_HALF = 4.4
PAVEMENT_WIDTH = 3.2
FRONT = ROAD_HALF + PAVEMENT_WIDTH
"""Distance of the house fronts from the centre line."""
CURB_HEIGHT = 0.14
STREET_SPAN = (-110.0, 190.0)
"""Ends of the street for drives of up to ten seconds; longer drives lengthen it."""
CROSS_SPAN = (-85.0, 85.0)

_LIFT = 0.006  # paint lies on the road by more than rays' rounding errors
_ROAD, _LINE, _STOP, _OTHER = 7, 8, 9, 10  # PandaSet classes


def compute_street_height(x: float, y: float, crossing: float) -> float:
    """Height of road or pavement; kerbs are ramps, because walkers use it."""
    beside = np.clip((abs(x) - ROAD_HALF) / 0.3, 0, 1)
    off_crossing = np.clip((abs(y - crossing) - CROSS_HALF) / 0.3, 0, 1)
    return float(CURB_HEIGHT * min(beside, off_crossing))


@dataclass(frozen=True)
class Ground:
    """The stuff of the street, one mesh per instance."""

    road: TriangleMesh
    left_pavement: TriangleMesh
    right_pavement: TriangleMesh
    lots: TriangleMesh


def build_ground(
    crossing: float, rng: np.random.Generator, palette: MaterialPalette, street: tuple[float, float] = STREET_SPAN
) -> Ground:
    """Everything horizontal between the ends of the `street`; the crossing street's middle is at y = `crossing`."""
    return Ground(
        join_meshes(
            [
                _add_asphalt(palette, street),
                _build_markings(crossing, palette, street),
                _build_covers(crossing, rng, palette, street),
            ]
        ),
        _build_pavement(-1, crossing, palette, street),
        _build_pavement(1, crossing, palette, street),
        _build_lots(crossing, palette, street),
    )


def _add_asphalt(palette: MaterialPalette, street: tuple[float, float]) -> TriangleMesh:
    asphalt = palette.add(Material(ASPHALT, (0.150, 0.150, 0.155), reflectivity=0.14))
    return build_floor((CROSS_SPAN[0], CROSS_SPAN[1]), street, 0.0, asphalt)


def _build_markings(crossing: float, palette: MaterialPalette, street: tuple[float, float]) -> TriangleMesh:
    def paint(semantic: int) -> int:
        return palette.add(
            Material(PAINTED_LINE, (0.62, 0.62, 0.60), (0.22, 0.22, 0.22), reflectivity=0.65, semantic=semantic)
        )

    line, stop, other = paint(_LINE), paint(_STOP), paint(_OTHER)
    near = CROSS_HALF + 5.4  # from the crossing's middle to the stop line
    parts = [
        *_build_dashes(np.arange(street[0], street[1], 7.5), 3.0, crossing, near, line),
        *_build_parking_bays(crossing, near, line, street),
    ]
    for sign in (-1, 1):  # towards −y and +y of the crossing, then towards −x and +x of it
        along = crossing + sign * (CROSS_HALF + 2.6)
        parts += [_build_stripe(x, along, 0.5, 3.0, other) for x in np.arange(-ROAD_HALF + 0.6, ROAD_HALF, 1.0)]
        across = sign * (ROAD_HALF + 2.0)
        parts += [
            _build_stripe(across, y, 3.0, 0.5, other)
            for y in np.arange(crossing - CROSS_HALF + 0.7, crossing + CROSS_HALF, 1.0)
        ]
        parts.append(_build_stripe(-sign * LANE, crossing + sign * near, 2.9, 0.4, stop))
        parts.append(_build_stripe(sign * (ROAD_HALF + 4.6), crossing + sign * 2.2, 0.4, 3.8, stop))
        parts.append(_build_arrow(-sign * LANE, crossing + sign * (near + 7), -sign, other))
        parts += [
            _build_stripe(sign * x, crossing, 2.0, 0.12, line) for x in np.arange(ROAD_HALF + 6, CROSS_SPAN[1], 5.0)
        ]
    return join_meshes(parts)


def _build_stripe(x: float, y: float, width: float, length: float, material: int) -> TriangleMesh:
    return build_floor((x - width / 2, x + width / 2), (y - length / 2, y + length / 2), _LIFT, material)


def _build_dashes(starts: np.ndarray, length: float, crossing: float, near: float, material: int) -> list[TriangleMesh]:
    middles = starts + length / 2
    return [_build_stripe(0, y, 0.14, length, material) for y in middles if abs(y - crossing) > near + length / 2]


def _build_parking_bays(crossing: float, near: float, material: int, street: tuple[float, float]) -> list[TriangleMesh]:
    """Edge lines of the parking strips with short ticks."""
    parts = []
    for start, end in ((street[0], crossing - near), (crossing + near, street[1])):
        for sign in (-1, 1):
            x = sign * 3.36
            parts.append(_build_stripe(x, 0.5 * (start + end), 0.10, end - start, material))
            parts += [_build_stripe(x + sign * 0.45, y, 0.9, 0.10, material) for y in np.arange(start + 3, end, 6.2)]
    return parts


def _build_arrow(x: float, y: float, forward: int, material: int) -> TriangleMesh:
    shaft = build_quad(
        [(x - 0.09, y - 1.5 * forward, _LIFT), (x + 0.09, y - 1.5 * forward, _LIFT),
         (x + 0.09, y + 0.5 * forward, _LIFT), (x - 0.09, y + 0.5 * forward, _LIFT)], material,
    )  # fmt: skip
    head = np.array([[[x - 0.34, y + 0.5 * forward, _LIFT], [x + 0.34, y + 0.5 * forward, _LIFT],
                      [x, y + 1.6 * forward, _LIFT]]])  # fmt: skip
    return join_meshes([shaft, build_flat_mesh(head, material)])


def _build_covers(
    crossing: float, rng: np.random.Generator, palette: MaterialPalette, street: tuple[float, float]
) -> TriangleMesh:
    """Manhole covers, and patches where the road was mended."""
    iron = palette.add(Material(PLAIN, (0.07, 0.065, 0.06), reflectivity=0.2))
    fresh = palette.add(Material(ASPHALT, (0.115, 0.115, 0.12), reflectivity=0.10))
    old = palette.add(Material(ASPHALT, (0.185, 0.182, 0.18), reflectivity=0.18))
    parts = []
    for y in np.arange(street[0] + 8, street[1], 19):
        x = rng.uniform(-2.6, 2.6)
        parts.append(build_disc((x, y + rng.uniform(-4, 4), 0.003), (0, 0, 1), 0.34, iron))
        width, length = rng.uniform(0.6, 1.6), rng.uniform(1.5, 6.0)
        x, y = rng.uniform(-2.8, 2.8), y + rng.uniform(4, 12)
        if abs(y - crossing) > CROSS_HALF + 12:
            patch = build_floor(
                (x - width, x + width), (y - length, y + length), 0.002, fresh if rng.random() < 0.6 else old
            )
            parts.append(patch)
    return join_meshes(parts)


def _compute_quadrant_spans(crossing: float, street: tuple[float, float]) -> list[tuple[float, float]]:
    """The two stretches of the street before and after the crossing."""
    return [(street[0], crossing - CROSS_HALF), (crossing + CROSS_HALF, street[1])]


def _build_pavement(side: int, crossing: float, palette: MaterialPalette, street: tuple[float, float]) -> TriangleMesh:
    """Pavements on one side (−1 left, 1 right) along both streets, with kerbstones and tree pits."""
    slabs = palette.add(Material(PAVING, (0.36, 0.345, 0.32), (0.17, 0.16, 0.15), 0.62, reflectivity=0.35))
    stone = palette.add(Material(PAVING, (0.44, 0.43, 0.41), (0.22, 0.21, 0.20), 1.05, reflectivity=0.4))

    def span(start: float, end: float) -> tuple[float, float]:
        return (min(side * start, side * end), max(side * start, side * end))

    parts = []
    curb = 0.16
    for stretch, (low, high) in enumerate(_compute_quadrant_spans(crossing, street)):
        inner = high if stretch == 0 else low  # the end at the crossing
        towards = -1 if stretch == 0 else 1
        strip = sorted((inner, inner + towards * PAVEMENT_WIDTH))
        parts.append(build_floor(span(ROAD_HALF + curb, FRONT), (low, high), CURB_HEIGHT, slabs))
        parts.append(build_floor(span(FRONT, CROSS_SPAN[1]), (strip[0], strip[1]), CURB_HEIGHT, slabs))
        parts.append(build_box((curb, high - low, CURB_HEIGHT + 0.01),
                         (side * (ROAD_HALF + curb / 2), 0.5 * (low + high), 0.5 * CURB_HEIGHT), stone))  # fmt: skip
        reach = CROSS_SPAN[1] - ROAD_HALF
        middle = (side * (ROAD_HALF + reach / 2), inner + towards * curb / 2, 0.5 * CURB_HEIGHT)
        parts.append(build_box((reach, curb, CURB_HEIGHT + 0.012), middle, stone))
    return join_meshes(parts)


def _build_lots(crossing: float, palette: MaterialPalette, street: tuple[float, float]) -> TriangleMesh:
    """Lawns and yards behind the pavements, and the land beyond the street."""
    grass = palette.add(Material(GRASS, (0.085, 0.15, 0.035), (0.16, 0.17, 0.06), reflectivity=0.4))
    parts = [build_floor((-500, 500), (street[0] - 390, street[1] + 410), -0.03, grass)]
    for low, high in ((street[0], crossing - CROSS_HALF - PAVEMENT_WIDTH),
                      (crossing + CROSS_HALF + PAVEMENT_WIDTH, street[1])):  # fmt: skip
        for x in ((-CROSS_SPAN[1], -FRONT), (FRONT, CROSS_SPAN[1])):
            parts.append(build_floor(x, (low, high), CURB_HEIGHT - 0.02, grass))
    return join_meshes(parts)
