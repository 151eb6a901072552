"""Trees, hedges and bushes. Frame: z up, the ground at z = 0, the trunk at x = y = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.materials import BARK, LEAF, Color, Material, MaterialPalette
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import build_cylinder, build_sphere, build_tube


@dataclass(frozen=True)
class Species:
    """Habit of a tree, in metres."""

    height: tuple[float, float]
    """Range of total heights."""
    trunk: float
    """Clear trunk as a share of the height."""
    crown: tuple[float, float]
    """Crown half-width as a share of the height; power by which it narrows upwards (0 = round)."""
    leaf: Color
    shade: Color
    """Second leaf colour."""


SPECIES = {
    "plane": Species((7.0, 9.0), 0.44, (0.30, 0.0), (0.10, 0.20, 0.035), (0.17, 0.25, 0.05)),
    "maple": Species((6.0, 7.5), 0.42, (0.27, 0.25), (0.22, 0.20, 0.03), (0.34, 0.20, 0.035)),
    "poplar": Species((9.0, 12.0), 0.30, (0.12, 0.35), (0.07, 0.16, 0.035), (0.12, 0.20, 0.04)),
    "spruce": Species((7.0, 11.0), 0.06, (0.22, 1.0), (0.03, 0.085, 0.04), (0.05, 0.11, 0.05)),
    "cherry": Species((4.8, 6.0), 0.50, (0.34, 0.0), (0.42, 0.16, 0.20), (0.52, 0.28, 0.30)),
}
"""Species by name."""


def build_tree(species: Species, rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A tree: trunk, boughs, and clumps of leaves around dark cores."""
    height = rng.uniform(*species.height)
    foot = species.trunk * height
    bark = palette.add(Material(BARK, (0.14, 0.10, 0.07), reflectivity=0.3))
    tint = rng.uniform(0.85, 1.15, 3)
    leaf = palette.add(_build_leaf_material(species, tint))
    lean = rng.uniform(-0.03, 0.03, 2) * height
    thick = 0.018 * height + 0.05
    trunk = build_tube(
        [(0, 0, -0.2), (0.3 * lean[0], 0.3 * lean[1], 0.5 * foot), (*lean, 0.75 * height)],
        [1.25 * thick, thick, 0.35 * thick],
        bark,
    )
    clumps = _draw_clumps(species, height, foot, lean, rng)
    boughs = [
        build_cylinder((*(0.6 * lean), 0.9 * foot), clump[:3], 0.4 * thick, bark, 6, 0.12 * thick)
        for clump in clumps[:5]
        if species.crown[1] < 0.5
    ]
    crown = [_build_clump(clump[:3], clump[3], leaf, rng) for clump in clumps]
    return join_meshes([trunk, *boughs, *crown])


def build_bush(
    length: float, width: float, height: float, rng: np.random.Generator, palette: MaterialPalette
) -> TriangleMesh:
    """A hedge along x, or a bush where `length` is short."""
    species = Species((0, 0), 0, (0, 0), (0.07, 0.16, 0.03), (0.12, 0.20, 0.05))
    leaf = palette.add(_build_leaf_material(species, rng.uniform(0.85, 1.15, 3)))
    count = max(1, round(length / (0.9 * width)))
    parts = []
    for x in (np.arange(count) + 0.5) * length / count - length / 2:
        centre = np.array([x, rng.uniform(-0.05, 0.05), 0.5 * height])
        radii = np.array([0.62 * width, 0.5 * width, 0.5 * height]) * rng.uniform(0.92, 1.08, 3)
        parts.append(_build_clump(centre, radii, leaf, rng, cards=70))
    return join_meshes(parts)


def _build_leaf_material(species: Species, tint: ndarray) -> Material:
    def apply_tint(color: Color) -> Color:
        r, g, b = (float(value) for value in np.round(np.array(color) * tint, 3))
        return r, g, b

    return Material(LEAF, apply_tint(species.leaf), apply_tint(species.shade), reflectivity=0.45)


def _draw_clumps(
    species: Species, height: float, foot: float, lean: ndarray, rng: np.random.Generator
) -> Float[ndarray, "n 4"]:
    """Centres and radii of leaf clumps that fill the crown, lowest boughs first."""
    half_width, narrowing = species.crown[0] * height, species.crown[1]
    count = 9 if narrowing < 0.3 else 13
    clumps = []
    for k in range(count):
        share = (k + 0.5) / count
        if narrowing == 0:
            direction = rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            place = direction * half_width * 0.55 * rng.uniform(0.8, 1.0)
            centre = np.array([*lean, foot + 0.95 * half_width]) + place * [1, 1, 0.95]
            radius = half_width * rng.uniform(0.48, 0.62)
        else:
            profile = 1 - share if narrowing >= 0.5 else np.sin(np.pi * (0.15 + 0.8 * share))
            reach = half_width * profile**narrowing
            angle = 2.4 * k + rng.uniform(-0.3, 0.3)
            out = 0.4 * reach
            z = foot + (height - foot) * (0.08 + 0.86 * share)
            centre = np.array([lean[0] + out * np.cos(angle), lean[1] + out * np.sin(angle), z])
            radius = max(0.3, reach * rng.uniform(0.62, 0.78))
        clumps.append([*centre, radius])
    return np.array(clumps)


def _build_clump(
    centre: ndarray, radii: float | ndarray, leaf: int, rng: np.random.Generator, cards: int = 190
) -> TriangleMesh:
    """Leaf cards on an ellipsoid around a slightly smaller core; all share the ellipsoid's normals, which makes the
    clump look like one soft body with a ragged outline."""
    radii = np.broadcast_to(np.asarray(radii, float), (3,))
    outward = rng.normal(size=(cards, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    place = centre + outward * radii * rng.uniform(0.86, 1.06, (cards, 1))
    tilt = outward + 0.75 * rng.normal(size=(cards, 3))
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)
    side = np.cross(tilt, rng.normal(size=(cards, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tilt, side)
    size = 0.19 * np.clip(radii.mean(), 0.5, 1.5) ** 0.5 * rng.uniform(0.7, 1.2, (cards, 1))
    ring = [place - size * side, place - 0.62 * size * other, place + size * side, place + 0.62 * size * other]
    corners = np.stack(ring, axis=1)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    normals = np.repeat(np.repeat(outward[:, None], 2, axis=0), 3, axis=1)
    core = build_sphere(centre, 0.88 * radii, leaf, 1)
    foliage = TriangleMesh(
        corners.astype(np.float32),
        corners.astype(np.float32),
        normals.reshape(-1, 3, 3).astype(np.float32),
        np.full(len(corners), leaf, np.int32),
    )
    return join_meshes([core, foliage])
