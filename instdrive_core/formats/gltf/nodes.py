"""The nodes of a glTF scene: which are shown, and where each stands."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.gltf.container import REMEDY, GltfFile
from instdrive_core.maths.rotations import matrix_from_quaternion

Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
"""From glTF's axes (y up, z back) to those of this program (y forward, z up); x stays."""
_FARTHEST = 1e9
"""Metres; what is moved farther does not fit float32."""


def list_nodes(gltf: GltfFile) -> list[tuple[dict[str, Any], Float64[ndarray, "4 4"]]]:
    """List the nodes of the scene that is shown first, each with its pose in axes with z up.

    Raises DataError where a node occurs twice, or has a matrix that is none.
    """
    pending = [(index, Z_UP_FROM_Y_UP) for index in reversed(_find_roots(gltf))]
    found, seen = [], set()
    while pending:
        index, parent = pending.pop()
        node = gltf.get_entry("nodes", index)
        if index in seen:
            raise DataError(gltf.path, f"node {index} stands in the tree twice", REMEDY)
        seen.add(index)
        pose = parent @ _parse_pose(gltf, node, index)
        if not (np.abs(pose) < _FARTHEST).all():
            raise DataError(gltf.path, f"node {index} is moved or scaled beyond {_FARTHEST:g}", REMEDY)
        found.append((node, pose))
        pending += [(child, pose) for child in reversed(_require_list(gltf, node.get("children", []), "children"))]
    return found


def decompose_pose(gltf: GltfFile, pose: Float64[ndarray, "4 4"], name: str) -> Float64[ndarray, "3 4"]:
    """Return a pose as [s R | t]. Raises DataError where it mirrors, flattens, shears or stretches unevenly."""
    linear = pose[:3, :3]
    determinant = np.linalg.det(linear)
    scale = np.cbrt(determinant) if determinant > 0 else 0.0
    if scale < 1e-9 or np.abs(linear @ linear.T / scale**2 - np.eye(3)).max() > 1e-4:
        problem = f"{name} is mirrored, sheared or stretched unevenly, which SH and rotations of splats cannot follow"
        raise DataError(gltf.path, problem, "Apply the transform of the node before export")
    return pose[:3].copy()


def _find_roots(gltf: GltfFile) -> list[Any]:
    scenes = gltf.get_entries("scenes")
    if scenes:
        return _require_list(gltf, gltf.get_entry("scenes", gltf.content.get("scene", 0)).get("nodes", []), "nodes")
    below = {child for node in gltf.get_entries("nodes") for child in _require_list(gltf, node.get("children", []), "")}
    return [index for index in range(len(gltf.get_entries("nodes"))) if index not in below]


def _require_list(gltf: GltfFile, value: Any, name: str) -> list[int]:
    if not isinstance(value, list) or not all(isinstance(entry, int) for entry in value):
        raise DataError(gltf.path, f"'{name}' of a node or scene is no list of numbers", REMEDY)
    return value


def _parse_pose(gltf: GltfFile, node: dict[str, Any], index: int) -> Float64[ndarray, "4 4"]:
    if "matrix" in node:
        return _parse_numbers(gltf, node, "matrix", 16, index).reshape(4, 4).T
    pose = np.eye(4)
    if "rotation" in node:
        pose[:3, :3] = matrix_from_quaternion(_parse_numbers(gltf, node, "rotation", 4, index)[[3, 0, 1, 2]])
    if "scale" in node:
        pose[:3, :3] *= _parse_numbers(gltf, node, "scale", 3, index)
    if "translation" in node:
        pose[:3, 3] = _parse_numbers(gltf, node, "translation", 3, index)
    return pose


def _parse_numbers(gltf: GltfFile, node: dict[str, Any], key: str, count: int, index: int) -> Float64[ndarray, " n"]:
    values = node[key]
    good = isinstance(values, list) and len(values) == count
    if not good or not all(isinstance(value, int | float) and abs(value) < 1e30 for value in values):
        raise DataError(gltf.path, f"'{key}' of node {index} is not {count} numbers", REMEDY)
    return np.array(values, np.float64)
