"""Walls with openings. Frame: the wall stands in the plane y = 0 from x = 0 to its width, and faces −y; z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import build_box

Span = tuple[float, float]


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
    corners = np.array([[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]])
    texcoords = np.column_stack([corners[:, 0] - origin[0], corners[:, 2] - origin[1], np.full(4, seed)])
    return _build_two_triangles(corners, texcoords, material)


def _build_cell(x: Span, z: Span, opening: Opening, materials: WallMaterials, seed: float) -> TriangleMesh:
    """A piece of wall around a hole, the hole's reveals, and what closes it."""
    middle = 0.5 * (x[0] + x[1])
    half = min(0.5 * opening.width, 0.5 * (x[1] - x[0]) - 0.02)
    hole_x = (middle - half, middle + half)
    hole_z = (z[0] + opening.sill, min(z[0] + opening.head, z[1] - 0.05))
    parts = [
        build_patch((x[0], hole_x[0]), z, 0, materials.wall),
        build_patch((hole_x[1], x[1]), z, 0, materials.wall),
        build_patch(hole_x, (hole_z[1], z[1]), 0, materials.wall),
        build_patch(hole_x, hole_z, opening.depth, opening.material, (hole_x[0], hole_z[0]), seed),
        *_build_reveals(hole_x, hole_z, opening.depth, materials.trim),
    ]
    if opening.sill > 0:
        parts.append(build_patch(hole_x, (z[0], hole_z[0]), 0, materials.wall))
    if opening.ledge:
        parts.append(build_box((2 * half + 0.2, 0.14, 0.07), (middle, -0.05, hole_z[0] - 0.035), materials.trim))
    return join_meshes(parts)


def _build_reveals(x: Span, z: Span, depth: float, material: int) -> list[TriangleMesh]:
    def strip(start: Span, end: Span) -> TriangleMesh:
        corners = np.array(
            [[start[0], 0, start[1]], [end[0], 0, end[1]], [end[0], depth, end[1]], [start[0], depth, start[1]]]
        )
        return _build_two_triangles(corners, corners, material)

    lower_left, lower_right, upper_right, upper_left = (x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])
    return [
        strip(lower_left, lower_right),
        strip(lower_right, upper_right),
        strip(upper_right, upper_left),
        strip(upper_left, lower_left),
    ]


def _build_two_triangles(corners: ndarray, texcoords: ndarray, material: int) -> TriangleMesh:
    index = np.array([[0, 1, 2], [0, 2, 3]])
    return build_flat_mesh(corners[index], material, texcoords[index])
