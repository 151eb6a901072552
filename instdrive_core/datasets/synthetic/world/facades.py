"""Walls with openings. Frame: the wall stands in the plane y = 0 from x = 0 to its width, and faces −y; z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import build_box

Span = tuple[float, float]
_Corners = list[tuple[float, float, float]]
_Rectangle = tuple[_Corners, _Corners, int]
"""Corners, their texture coordinates, material."""


@dataclass(frozen=True)
class Opening:
    """A window, door or gate that fills a hole in a wall cell."""

    width: float
    """Metres; at most the cell's."""
    sill: float
    """Height of the lower edge over the floor."""
    head: float
    """Height of the upper edge over the floor."""
    depth: float
    """Metres by which it is set back."""
    material: int
    ledge: bool = False
    """A window sill that stands out."""


@dataclass(frozen=True)
class WallMaterials:
    """Material numbers of a wall."""

    wall: int
    trim: int


def build_storey(
    width: float,
    z: Span,
    openings: Sequence[Opening | None],
    materials: WallMaterials,
    rng: np.random.Generator,
) -> TriangleMesh:
    """One storey of a wall: as many equal cells as `openings`, each with its hole or none."""
    bay = width / len(openings)
    parts = []
    for column, opening in enumerate(openings):
        x = (column * bay, (column + 1) * bay)
        if opening is None:
            parts.append(build_patch(x, z, 0.0, materials.wall))
        else:
            parts.append(_build_cell(x, z, opening, materials, float(rng.integers(1 << 20))))
    return join_meshes(parts)


def build_patch(
    x: Span, z: Span, y: float, material: int, origin: Span = (0.0, 0.0), seed: float = 0.0
) -> TriangleMesh:
    """A rectangle parallel to the wall; its texture is measured from `origin`."""
    return _build_rectangles([_place_patch(x, z, y, material, origin, seed)])


def _build_cell(x: Span, z: Span, opening: Opening, materials: WallMaterials, seed: float) -> TriangleMesh:
    """A piece of wall around a hole, the hole's reveals, and what closes it."""
    middle = 0.5 * (x[0] + x[1])
    half = min(0.5 * opening.width, 0.5 * (x[1] - x[0]) - 0.02)
    hole_x = (middle - half, middle + half)
    hole_z = (z[0] + opening.sill, min(z[0] + opening.head, z[1] - 0.05))
    rectangles = [
        _place_patch((x[0], hole_x[0]), z, 0, materials.wall),
        _place_patch((hole_x[1], x[1]), z, 0, materials.wall),
        _place_patch(hole_x, (hole_z[1], z[1]), 0, materials.wall),
        _place_patch(hole_x, hole_z, opening.depth, opening.material, (hole_x[0], hole_z[0]), seed),
        *_place_reveals(hole_x, hole_z, opening.depth, materials.trim),
    ]
    if opening.sill > 0:
        rectangles.append(_place_patch(hole_x, (z[0], hole_z[0]), 0, materials.wall))
    cell = _build_rectangles(rectangles)
    if not opening.ledge:
        return cell
    ledge = build_box((2 * half + 0.2, 0.14, 0.07), (middle, -0.05, hole_z[0] - 0.035), materials.trim)
    return join_meshes([cell, ledge])


def _place_patch(x: Span, z: Span, y: float, material: int, origin: Span = (0.0, 0.0), seed: float = 0.0) -> _Rectangle:
    corners = [(x[0], y, z[0]), (x[1], y, z[0]), (x[1], y, z[1]), (x[0], y, z[1])]
    return corners, [(right - origin[0], up - origin[1], seed) for right, _, up in corners], material


def _place_reveals(x: Span, z: Span, depth: float, material: int) -> list[_Rectangle]:
    """The four sides of a hole, counter-clockwise from the lower one."""
    around = [(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])]
    sides = [
        [(start[0], 0, start[1]), (end[0], 0, end[1]), (end[0], depth, end[1]), (start[0], depth, start[1])]
        for start, end in zip(around, around[1:] + around[:1], strict=True)
    ]
    return [(side, side, material) for side in sides]


def _build_rectangles(rectangles: list[_Rectangle]) -> TriangleMesh:
    """Two triangles each, all at once: a street has tens of thousands."""
    places, texcoords, materials = zip(*rectangles, strict=True)
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    corners, texcoords = (np.array(each, float)[:, halves].reshape(-1, 3, 3) for each in (places, texcoords))
    return build_flat_mesh(corners, np.repeat(np.array(materials, np.int32), 2), texcoords)
