"""A trained-like street with instances, of any size, as the .ply that the editor's speed is measured on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64, UInt32
from numpy import ndarray

from benchmarks.workload import generate_workload
from instdrive_core.formats.registry import save_scene
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

SIZE = (1280, 720)
SH_REST = 15
"""Coefficients above the constant: degree 3, as 3DGS trains them."""
STREET = 1_000_000
"""Gaussians of each of the streets that lie side by side in a scene larger than that."""
BLOCK = np.array([5.0, 3.0, 3.0])
"""Metres: the street is cut into instances of about a car's size."""


def write_street(folder: Path, count: int, block: Float64[ndarray, "3"] = BLOCK) -> tuple[Path, tuple[Camera, ...]]:
    """Write a scene of `count` Gaussians; returns its file and cameras in it that look along the street.

    Every `block` (metres along each axis) of it is an instance.

    Raises DataError where the common workload cannot be generated.
    """
    workload, rng = generate_workload(count, *SIZE, "trained"), np.random.default_rng(3)
    gaussians = Gaussians(
        means=workload.means,
        quats=workload.quats,
        log_scales=workload.log_scales,
        opacity_logits=logit(workload.opacities),
        sh_dc=dc_from_color(workload.channels[:, :3]),
        sh_rest=rng.normal(0, 0.04, (count, SH_REST, 3)).astype(np.float32),
        features=np.zeros((count, 0), np.float32),
    )
    ids, zeros = _block_ids(workload.means, block), np.zeros(count, np.uint32)
    nodes = np.zeros(count, np.uint16)
    scene = Scene(gaussians, ids, zeros, nodes, build_instance_table(ids, gaussians.means, zeros, nodes))
    path = folder / f"street_{count}.ply"
    save_scene(path, scene)
    return path, workload.cameras


def write_tiled_street(folder: Path, count: int) -> tuple[Path, tuple[Camera, ...]]:
    """Write a scene without harmonics of many streets side by side, a million Gaussians each.

    Returns its file and cameras that look along the first of them. Raises DataError as `write_street` does.
    """
    street, places = generate_workload(min(count, STREET), *SIZE, "trained"), np.arange(count)
    rows, tile = places % len(street.means), places // len(street.means)
    width = np.ptp(street.means[:, 1])
    means = street.means[rows]
    means[:, 1] += tile * width
    gaussians = Gaussians(
        means=means,
        quats=street.quats[rows],
        log_scales=street.log_scales[rows],
        opacity_logits=logit(street.opacities)[rows],
        sh_dc=dc_from_color(street.channels[:, :3])[rows],
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
    of_one = _block_ids(street.means, BLOCK)
    ids = (of_one[rows] + tile * of_one.max()).astype(np.uint32)
    zeros, nodes = np.zeros(count, np.uint32), np.zeros(count, np.uint16)
    path = folder / f"streets_{count}.ply"
    save_scene(path, Scene(gaussians, ids, zeros, nodes, build_instance_table(ids, means, zeros, nodes)))
    return path, street.cameras


def _block_ids(means: Float32[ndarray, "n 3"], block: Float64[ndarray, "3"]) -> UInt32[ndarray, " n"]:
    cells = np.floor(means / block).astype(np.int64)
    _, place = np.unique(cells, axis=0, return_inverse=True)
    return (place.reshape(-1) + 1).astype(np.uint32)
