"""Buildings. Frame: the front stands in the plane y = 0 from x = 0 to its width and faces −y; z up from the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from instdrive_core.datasets.synthetic.world.facades import Opening, WallMaterials, build_patch, build_storey
from instdrive_core.datasets.synthetic.world.materials import (
    BRICK,
    PLAIN,
    PLASTER,
    POSTER,
    ROOF,
    SHUTTER,
    STRIPES,
    WINDOW,
    WOOD,
    Color,
    Material,
    MaterialPalette,
)
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import build_box, build_floor, build_quad

GROUND_FLOOR, UPPER_FLOOR = 3.6, 3.05
"""Storey heights in metres."""

_BRICKS: tuple[Color, ...] = ((0.30, 0.10, 0.06), (0.42, 0.21, 0.12), (0.24, 0.13, 0.09), (0.50, 0.36, 0.22))
_PLASTERS: tuple[Color, ...] = (
    (0.66, 0.58, 0.42), (0.62, 0.62, 0.58), (0.60, 0.38, 0.26), (0.36, 0.47, 0.48), (0.66, 0.50, 0.25),
    (0.46, 0.52, 0.36), (0.60, 0.42, 0.40), (0.30, 0.36, 0.48), (0.72, 0.68, 0.60),
)  # fmt: skip
_ACCENTS: tuple[Color, ...] = (
    (0.45, 0.04, 0.04), (0.04, 0.20, 0.12), (0.05, 0.12, 0.34), (0.55, 0.30, 0.03), (0.10, 0.10, 0.11),
    (0.05, 0.30, 0.34), (0.32, 0.06, 0.24),
)  # fmt: skip

_SHUTTERS: tuple[Color, ...] = ((0.45, 0.46, 0.46), (0.16, 0.24, 0.34), (0.42, 0.38, 0.28))
_TILES: tuple[Color, ...] = ((0.34, 0.12, 0.07), (0.13, 0.13, 0.14), (0.24, 0.16, 0.11))


@dataclass(frozen=True)
class _Looks:
    """Drawn once per building."""

    materials: WallMaterials
    window: Opening
    tall_window: Opening
    shop_window: Opening
    door: Opening
    gate: Opening
    roof: int
    accent: int
    awning: int
    letters: int
    metal: int


def build_building(
    width: float, depth: float, floors: int, use: str, rng: np.random.Generator, palette: MaterialPalette
) -> TriangleMesh:
    """A building.

    Args:
        use: ``shop``, ``home`` or ``garage``: what the ground floor looks like.
    """
    looks = _draw_looks(use, rng, palette)
    bays = max(2, round(width / rng.uniform(2.5, 3.3)))
    height = GROUND_FLOOR + UPPER_FLOOR * (floors - 1)
    front = [_build_ground_storey(width, bays, use, looks, rng)]
    upper = looks.tall_window if rng.random() < 0.4 else looks.window
    for level in range(1, floors):
        z = _compute_level(level)
        front.append(build_storey(width, z, [upper] * bays, looks.materials, rng))
    front += _build_front_ornaments(width, floors, bays, use, looks, rng)
    sides = [
        _build_side_wall(depth, floors, looks, rng).at(width, 0, 0, np.pi / 2),
        build_patch((0, width), (0, height), 0, looks.materials.wall).at(width, depth, 0, np.pi),
        _build_side_wall(depth, floors, looks, rng).at(0, depth, 0, -np.pi / 2),
    ]
    gabled = floors <= 3 and use != "garage" and rng.random() < 0.45
    roof = (
        _build_gable_roof(width, depth, height, looks) if gabled else _build_flat_roof(width, depth, height, looks, rng)
    )
    return join_meshes([*front, *sides, roof])


def _compute_level(level: int) -> tuple[float, float]:
    """Lower and upper edge of a storey over the ground."""
    if level == 0:
        return 0.0, GROUND_FLOOR
    return GROUND_FLOOR + (level - 1) * UPPER_FLOOR, GROUND_FLOOR + level * UPPER_FLOOR


def _pick(colors: tuple[Color, ...], rng: np.random.Generator) -> Color:
    color = np.array(colors[rng.integers(len(colors))]) * rng.uniform(0.88, 1.1)
    r, g, b = (float(value) for value in np.round(color, 3))
    return r, g, b


def _draw_looks(use: str, rng: np.random.Generator, palette: MaterialPalette) -> _Looks:
    if rng.random() < 0.42:
        wall = Material(BRICK, _pick(_BRICKS, rng), (0.42, 0.39, 0.35), reflectivity=0.35)
    else:
        wall = Material(PLASTER, _pick(_PLASTERS, rng), reflectivity=0.5)
    trim = Material(PLAIN, (0.60, 0.57, 0.52) if rng.random() < 0.6 else (0.20, 0.19, 0.18), reflectivity=0.45)
    frame: Color = (0.72, 0.72, 0.70) if rng.random() < 0.6 else (0.10, 0.08, 0.07)
    width = float(rng.uniform(1.05, 1.5))

    def window(size: float) -> int:
        glass = (0.75, 0.85, 0.95)
        return palette.add(Material(WINDOW, glass, frame, round(size, 2), gloss=0.5, reflectivity=0.12))

    accent = _pick(_ACCENTS, rng)
    letters = Material(POSTER, accent, (0.80, 0.78, 0.70), 0.22, float(rng.integers(1000)), reflectivity=0.5)
    shutter = Material(SHUTTER, _pick(_SHUTTERS, rng), (0.1, 0.1, 0.1), 0.28, reflectivity=0.4)
    tiles = Material(ROOF, _pick(_TILES, rng), (0.04, 0.035, 0.03), reflectivity=0.3)
    width = round(width, 2)
    return _Looks(
        WallMaterials(palette.add(wall), palette.add(trim)),
        Opening(width, 0.95, 2.45, 0.16, window(width), ledge=True),
        Opening(width, 0.45, 2.55, 0.18, window(width), ledge=True),
        Opening(2.3, 0.5, 2.75, 0.14, window(2.3)),
        Opening(1.15, 0.02, 2.45, 0.25, palette.add(Material(WOOD, accent, size=0.23, reflectivity=0.3))),
        Opening(2.5, 0.0, 2.7, 0.20, palette.add(shutter)),
        palette.add(tiles),
        palette.add(Material(PLAIN, accent, reflectivity=0.3)),
        palette.add(Material(STRIPES, accent, (0.75, 0.73, 0.66), 0.5, reflectivity=0.5)),
        palette.add(letters),
        palette.add(Material(PLAIN, (0.10, 0.10, 0.11), gloss=0.1, reflectivity=0.3)),
    )


def _build_ground_storey(width: float, bays: int, use: str, looks: _Looks, rng: np.random.Generator) -> TriangleMesh:
    entrance = int(rng.integers(bays))
    fill = {"shop": looks.shop_window, "home": looks.window, "garage": looks.gate}[use]
    openings: list[Opening | None] = [looks.door if bay == entrance else fill for bay in range(bays)]
    return build_storey(width, _compute_level(0), openings, looks.materials, rng)


def _build_front_ornaments(
    width: float, floors: int, bays: int, use: str, looks: _Looks, rng: np.random.Generator
) -> list[TriangleMesh]:
    """String courses, plinth, balconies; name board and awnings of shops."""
    trim = looks.materials.trim
    parts = [build_box((width, 0.10, 0.16), (width / 2, -0.05, GROUND_FLOOR - 0.02), trim)]
    bay = width / bays
    if use == "shop":
        parts.append(build_box((0.9 * width, 0.10, 0.58), (width / 2, -0.06, 3.18), looks.accent))
        parts.append(_build_facing_patch(0.12 * width, 0.88 * width, -0.115, 2.96, 3.40, looks.letters))
        if rng.random() < 0.7:
            parts.append(_build_awning(0.05 * width, 0.95 * width, looks.awning))
    else:
        parts.append(build_box((width, 0.06, 0.35), (width / 2, -0.03, 0.175), trim) if use == "garage" else
                     build_box((width, 0.05, 0.02), (width / 2, -0.02, 0.5), trim))  # fmt: skip
    if use == "home" and floors > 2 and rng.random() < 0.6:
        for level in range(1, floors):
            for column in range(1, bays, 2):
                parts.append(
                    _build_balcony((column + 0.5) * bay, _compute_level(level)[0], min(bay * 0.85, 2.2), looks)
                )
    return parts


def _build_facing_patch(x0: float, x1: float, y: float, z0: float, z1: float, material: int) -> TriangleMesh:
    return build_quad([(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)], material)


def _build_awning(x0: float, x1: float, material: int) -> TriangleMesh:
    slope = build_quad([(x0, -1.15, 2.42), (x1, -1.15, 2.42), (x1, -0.05, 2.88), (x0, -0.05, 2.88)], material)
    return join_meshes([slope, _build_facing_patch(x0, x1, -1.15, 2.22, 2.42, material)])


def _build_balcony(x: float, z: float, width: float, looks: _Looks) -> TriangleMesh:
    slab = build_box((width, 0.9, 0.14), (x, -0.45, z + 0.07), looks.materials.trim)
    bars = [build_box((0.05, 0.03, 0.92), (x + offset, -0.87, z + 0.55), looks.metal)
            for offset in np.linspace(-width / 2 + 0.03, width / 2 - 0.03, 8)]  # fmt: skip
    rails = [build_box((width, 0.05, 0.06), (x, -0.87, z + 1.02), looks.metal)]
    for side in (-1, 1):
        rails.append(build_box((0.04, 0.86, 0.5), (x + side * (width / 2 - 0.02), -0.45, z + 0.75), looks.metal))
    return join_meshes([slab, *bars, *rails])


def _build_side_wall(width: float, floors: int, looks: _Looks, rng: np.random.Generator) -> TriangleMesh:
    bays = max(1, round(width / 4.2))
    parts = []
    for level in range(floors):
        glazed = [level > 0 and rng.random() < 0.75 for _ in range(bays)]
        parts.append(
            build_storey(
                width, _compute_level(level), [looks.window if pane else None for pane in glazed], looks.materials, rng
            )
        )
    return join_meshes(parts)


def _build_flat_roof(
    width: float, depth: float, height: float, looks: _Looks, rng: np.random.Generator
) -> TriangleMesh:
    """A roof behind a parapet with a cornice, and something that stands on it."""
    trim = looks.materials.trim
    rim = 0.55
    parts = [
        build_floor((0, width), (0, depth), height + 0.05, looks.roof),
        build_box((width, 0.2, rim), (width / 2, 0.1, height + rim / 2), looks.materials.wall),
        build_box((width, 0.2, rim), (width / 2, depth - 0.1, height + rim / 2), looks.materials.wall),
        build_box((0.2, depth - 0.4, rim), (0.1, depth / 2, height + rim / 2), looks.materials.wall),
        build_box((0.2, depth - 0.4, rim), (width - 0.1, depth / 2, height + rim / 2), looks.materials.wall),
        build_box((width + 0.1, 0.45, 0.16), (width / 2, -0.02, height + rim + 0.02), trim),
        build_box((width + 0.04, 0.26, 0.14), (width / 2, -0.04, height - 0.12), trim),
    ]
    if rng.random() < 0.6:
        parts.append(build_box((1.8, 1.6, 1.2), (rng.uniform(1.5, width - 1.5), 3.0, height + 0.6), looks.metal))
    return join_meshes(parts)


def _build_gable_roof(width: float, depth: float, height: float, looks: _Looks) -> TriangleMesh:
    """Two slopes with the ridge along the street, and a chimney."""
    rise, eave = 0.34 * depth, 0.35
    ridge = height + rise
    low = height - eave * rise / (depth / 2)
    front = build_quad([(-0.2, -eave, low), (width + 0.2, -eave, low), (width + 0.2, depth / 2, ridge),
                  (-0.2, depth / 2, ridge)], looks.roof)  # fmt: skip
    back = build_quad([(width + 0.2, depth + eave, low), (-0.2, depth + eave, low), (-0.2, depth / 2, ridge),
                 (width + 0.2, depth / 2, ridge)], looks.roof)  # fmt: skip
    gables = []
    for x in (0.0, width):
        corners = np.array([[[x, 0, height], [x, depth, height], [x, depth / 2, ridge]]])
        gables.append(build_flat_mesh(corners, looks.materials.wall, corners[..., [1, 2, 0]]))
    chimney = build_box((0.7, 0.6, 1.6), (0.25 * width, 0.38 * depth, ridge - 0.2), looks.materials.wall)
    gutter = build_box((width + 0.4, 0.12, 0.12), (width / 2, -eave, low - 0.04), looks.metal)
    return join_meshes([front, back, *gables, chimney, gutter])
