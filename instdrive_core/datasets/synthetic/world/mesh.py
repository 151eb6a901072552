"""Triangle soup that carries what shading needs: texture coordinates, smooth normals and materials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy import ndarray


@dataclass(frozen=True)
class TriangleMesh:
    """n triangles that share nothing, so that meshes join by concatenation."""

    corners: Float32[ndarray, "n 3 3"]
    """Positions of the three corners (metres)."""
    texcoords: Float32[ndarray, "n 3 3"]
    """Points at which textures are evaluated: metres in the object's own frame, whatever its pose."""
    normals: Float32[ndarray, "n 3 3"]
    """Unit shading normals at the corners."""
    materials: Int32[ndarray, " n"]
    """Index into the street's palette."""

    def __len__(self) -> int:
        return len(self.materials)

    def transform(self, pose: Float[ndarray, "4 4"]) -> TriangleMesh:
        """Move the mesh by a rigid transform; its texture stays glued to it."""
        rotation = pose[:3, :3]
        return replace(
            self,
            corners=(self.corners @ rotation.T + pose[:3, 3]).astype(np.float32),
            normals=(self.normals @ rotation.T).astype(np.float32),
        )

    def at(self, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> TriangleMesh:
        """Turn the mesh about z by `yaw` (radians, counter-clockwise) and move it to (x, y, z)."""
        return self.transform(build_planar_pose(x, y, z, yaw))

    def scale(self, x: float, y: float, z: float) -> TriangleMesh:
        """Stretch the mesh along the axes, texture included."""
        factors = np.array([x, y, z], np.float32)
        normals = self.normals / factors
        return replace(
            self,
            corners=self.corners * factors,
            texcoords=self.texcoords * factors,
            normals=(normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32),
        )

    def smooth_normals(self, crease: float = 40.0) -> TriangleMesh:
        """Average normals over triangles that meet at a corner under less than `crease` degrees."""
        weighted = _compute_area_normals(self.corners.astype(np.float64))
        unit = weighted / np.maximum(np.linalg.norm(weighted, axis=-1, keepdims=True), 1e-12)
        keys = np.round(self.corners.reshape(-1, 3) * 1e4).astype(np.int64)
        _, group = np.unique(keys, axis=0, return_inverse=True)
        order = np.argsort(group, kind="stable")
        starts = np.flatnonzero(np.r_[True, np.diff(group[order]) > 0])
        normals = np.empty((len(group), 3))
        limit = np.cos(np.radians(crease))
        for members in np.split(order, starts[1:]):
            triangles = members // 3
            alike = unit[triangles] @ unit[triangles].T > limit
            normals[members] = alike @ weighted[triangles]
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
        return replace(self, normals=normals.reshape(-1, 3, 3).astype(np.float32))

    def bounds(self) -> tuple[Float32[ndarray, "3"], Float32[ndarray, "3"]]:
        """Lowest and highest corner coordinates."""
        flat = self.corners.reshape(-1, 3)
        return flat.min(axis=0), flat.max(axis=0)


def build_planar_pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Float[ndarray, "4 4"]:
    """Build a rigid transform that turns about z by `yaw` (radians) and moves to (x, y, z)."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, -sine, 0, x], [sine, cosine, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def join_meshes(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Join all triangles of `meshes`, in order."""
    return TriangleMesh(
        np.concatenate([mesh.corners for mesh in meshes]),
        np.concatenate([mesh.texcoords for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.materials for mesh in meshes]),
    )


def build_flat_mesh(
    corners: ndarray, material: int | Int32[ndarray, " n"], texcoords: ndarray | None = None
) -> TriangleMesh:
    """Build a mesh with flat normals, of one material or one for each triangle; texture coordinates default to the
    positions."""
    corners = np.asarray(corners, np.float32)
    normals = _compute_area_normals(corners)
    normals /= np.sqrt(np.maximum((normals * normals).sum(axis=-1, keepdims=True), 1e-24))
    return TriangleMesh(
        corners,
        corners.copy() if texcoords is None else np.asarray(texcoords, np.float32),
        np.repeat(normals[:, None], 3, axis=1),
        np.full(len(corners), material, np.int32),
    )


def _compute_area_normals(corners: Float[ndarray, "n 3 3"]) -> Float[ndarray, "n 3"]:
    """Compute normals as long as twice the area. Spelled out, because numpy's cross is slow on the many small parts."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    ax, ay, az, bx, by, bz = a[:, 0], a[:, 1], a[:, 2], b[:, 0], b[:, 1], b[:, 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
