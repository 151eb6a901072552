"""Shapes that everything in the street is put together from, wound counter-clockwise seen from outside."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import trimesh
from jaxtyping import Float
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes

Point = Sequence[float] | ndarray

_BOX_FACES = np.array(
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
)  # −z, +z, −y, +y, −x, +x of corners numbered x + 2y + 4z


def build_quad(corners: Float[ndarray, "4 3"] | Sequence[Point], material: int, seed: float = 0.0) -> TriangleMesh:
    """A flat four-sided patch. Its texture runs in metres along the first and the last edge; `seed` is the third
    texture coordinate, by which a material can tell patches apart."""
    corners = np.asarray(corners, np.float64)
    right, up = corners[1] - corners[0], corners[3] - corners[0]
    right = right / max(np.linalg.norm(right), 1e-9)
    up = up - right * (up @ right)
    up = up / max(np.linalg.norm(up), 1e-9)
    offset = corners - corners[0]
    texcoords = np.stack([offset @ right, offset @ up, np.full(4, seed)], axis=1)
    index = np.array([[0, 1, 2], [0, 2, 3]])
    return build_flat_mesh(corners[index], material, texcoords[index])


def build_floor(x: tuple[float, float], y: tuple[float, float], z: float, material: int) -> TriangleMesh:
    """A horizontal rectangle that faces up; its texture coordinates are the position."""
    corners = np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])
    return build_flat_mesh(corners[[[0, 1, 2], [0, 2, 3]]], material)


def build_box(size: Point, centre: Point, material: int, taper: tuple[float, float] = (1.0, 1.0)) -> TriangleMesh:
    """A box; its upper face is scaled by `taper` in x and y."""
    corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    corners[4:, :2] *= taper
    corners = corners * np.asarray(size, float) + np.asarray(centre, float)
    faces = corners[_BOX_FACES]
    return build_flat_mesh(faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3), material)


def build_loft(
    sections: Float[ndarray, "s p 3"], material: int, closed: bool = True, capped: bool = True
) -> TriangleMesh:
    """A skin over cross-sections of equal point counts; `closed` joins each section's ends, `capped` closes the first
    and last one by a fan around its centroid (sections must be star-shaped)."""
    sections = np.asarray(sections, np.float64)
    following = np.roll(sections, -1, axis=1) if closed else sections[:, 1:]
    current = sections if closed else sections[:, :-1]
    a, b, c, d = current[:-1], following[:-1], following[1:], current[1:]
    triangles = [np.stack([a, b, c], axis=2).reshape(-1, 3, 3), np.stack([a, c, d], axis=2).reshape(-1, 3, 3)]
    if capped:
        for section, flipped in ((sections[0], True), (sections[-1], False)):
            ring = section[::-1] if flipped else section
            centre = np.broadcast_to(section.mean(axis=0), ring.shape)
            triangles.append(np.stack([centre, ring, np.roll(ring, -1, axis=0)], axis=1))
    merged = np.concatenate(triangles)
    area = np.linalg.norm(np.cross(merged[:, 1] - merged[:, 0], merged[:, 2] - merged[:, 0]), axis=1)
    return build_flat_mesh(merged[area > 1e-9], material)


def build_tube(points: Sequence[Point], radii: Sequence[float], material: int, sides: int = 10) -> TriangleMesh:
    """A round limb through `points` with the given radii, smooth-shaded."""
    path = np.asarray(points, np.float64)
    directions = np.gradient(path, axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    helper = np.where(np.abs(directions[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(helper, directions)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(directions, side)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.cos(angles)[None, :, None] * side[:, None] + np.sin(angles)[None, :, None] * other[:, None]
    return build_loft(path[:, None] + np.asarray(radii)[:, None, None] * circle, material).smooth_normals(50.0)


def build_cylinder(
    start: Point, end: Point, radius: float, material: int, sides: int = 12, tip: float | None = None
) -> TriangleMesh:
    """A round bar from `start` to `end`, `tip` its radius at the end."""
    return build_tube([start, end], [radius, radius if tip is None else tip], material, sides)


def build_disc(centre: Point, normal: Point, radius: float, material: int, sides: int = 16) -> TriangleMesh:
    """A flat round patch; its texture coordinates are (right, up, 0) from its centre, in metres."""
    centre, normal = np.asarray(centre, float), np.asarray(normal, float)
    normal = normal / np.linalg.norm(normal)
    up = np.array([0.0, 0, 1]) if abs(normal[2]) < 0.9 else np.array([0.0, 1, 0])
    right = np.cross(up, normal)
    right /= np.linalg.norm(right)
    up = np.cross(normal, right)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False) + np.pi / sides
    flat = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ring = centre + flat[:, :1] * right + flat[:, 1:] * up
    texture = np.concatenate([flat, np.zeros((sides, 1))], axis=1)
    after = np.roll(np.arange(sides), -1)
    middle = np.broadcast_to(centre, ring.shape)
    return build_flat_mesh(
        np.stack([middle, ring, ring[after]], axis=1),
        material,
        np.stack([np.zeros_like(texture), texture, texture[after]], axis=1),
    )


@cache
def _build_unit_sphere(subdivisions: int) -> ndarray:
    return np.asarray(trimesh.creation.icosphere(subdivisions).triangles)


def build_sphere(centre: Point, radii: Point, material: int, subdivisions: int = 2) -> TriangleMesh:
    """An ellipsoid with smooth normals."""
    unit = _build_unit_sphere(subdivisions)
    radii = np.asarray(radii, float)
    normals = unit / radii
    mesh = build_flat_mesh(unit * radii + np.asarray(centre, float), material)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return TriangleMesh(mesh.corners, mesh.texcoords, normals.astype(np.float32), mesh.materials)


def build_decal(
    face: Float[ndarray, "4 3"], u: tuple[float, float], v: tuple[float, float], material: int, lift: float = 0.004
) -> TriangleMesh:
    """A patch on a four-sided `face`, from fractions `u` along its first edge and `v` along its last one, lifted by
    some millimetres so that it covers the face."""
    face = np.asarray(face, np.float64)
    normal = np.cross(face[2] - face[0], face[3] - face[1])
    normal /= np.linalg.norm(normal)

    def point(s: float, t: float) -> ndarray:
        return (1 - t) * ((1 - s) * face[0] + s * face[1]) + t * ((1 - s) * face[3] + s * face[2])

    corners = np.stack([point(u[0], v[0]), point(u[1], v[0]), point(u[1], v[1]), point(u[0], v[1])])
    return build_quad(corners + lift * normal, material)


def mirror(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh reflected in the plane x = 0, wound the right way round."""
    flip = np.array([-1, 1, 1], np.float32)
    return TriangleMesh(
        (mesh.corners * flip)[:, [0, 2, 1]],
        mesh.texcoords[:, [0, 2, 1]],
        (mesh.normals * flip)[:, [0, 2, 1]],
        mesh.materials,
    )


def add_mirror_image(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh and its mirror image."""
    return join_meshes([mesh, mirror(mesh)])
