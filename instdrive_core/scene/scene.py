"""A scene: background and actors in one array of Gaussians, sky, instances, cameras."""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
from jaxtyping import Float32, Float64, UInt8, UInt16, UInt32
from numpy import ndarray

from instdrive_core.instances.table import InstanceTable
from instdrive_core.maths.rotations import (
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from instdrive_core.scene.camera import Camera, CameraView, PhotoLag
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.seen_moving import SeenMover
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track, find_node_poses


@dataclass
class Scene:
    """What is edited and exported. Splat id = row, stable in a session; row order = background, then actors.

    Node 0 is the background; node k is `actors[k - 1]`, whose Gaussians live in that track's box frame.
    """

    gaussians: Gaussians
    instance_ids: UInt32[ndarray, " n"]
    """0 = none. Sole writer: `edits/bases/relabel.py`."""
    codewords: UInt32[ndarray, " n"]
    """Written by training only."""
    nodes: UInt16[ndarray, " n"]
    table: InstanceTable = field(default_factory=InstanceTable)
    actors: tuple[Track, ...] = ()
    sky: Sky | None = None
    views: tuple[CameraView, ...] = ()
    origin: Float64[ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """World position (metres) of the scene's coordinate origin; UTM-sized poses do not fit float32."""
    code_bits: int = 0
    """d of the codebook {-1, 1}^d; 0 where the scene has no codewords."""
    extra: dict[str, ndarray] = field(default_factory=dict)
    """Per-splat columns (n,) that the program does not know; kept from file to file."""
    exposures: Exposures | None = None
    """How the training photos came out; pictures drawn of the scene leave it out."""
    antialiased: bool = False
    """Whether it was trained so that a splat fades as the low-pass filter of pictures widens it (Mip-Splatting, Yu et
    al. 2024). Drawn otherwise, small splats come out too opaque."""

    seen_movers: tuple[SeenMover, ...] = ()
    """What its photos show moving and it does not hold."""
    start: Camera | None = None
    """Where the user looked from when it was exported; a .ply keeps it, with the sky."""
    left_out: tuple[str, ...] = ()
    """What its file holds and it does not, each with the reason; said when the file is opened, never saved."""

    def __post_init__(self) -> None:
        count = len(self.gaussians)
        for name in ("instance_ids", "codewords", "nodes"):
            if getattr(self, name).shape != (count,):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected ({count},)")
        for name, column in self.extra.items():
            if column.shape != (count,):
                raise ValueError(f"extra column {name} has shape {column.shape}, expected ({count},)")
        if count and int(self.nodes.max()) > len(self.actors):
            raise ValueError(f"nodes name actor {int(self.nodes.max())}, the scene has {len(self.actors)}")

    def __len__(self) -> int:
        return len(self.gaussians)

    def find_node_poses(
        self, time: float, lag: PhotoLag | None = None
    ) -> tuple[Float64[ndarray, "m 4 4"], UInt8[ndarray, " m"]]:
        """Find world_from_node of background and actors at `time` (s), as a photo with this `lag` shows them, and which
        of them exist then."""
        return find_node_poses(self.actors, time, lag)


def scene_from_gaussians(gaussians: Gaussians) -> Scene:
    """Make a static scene without instances of bare Gaussians."""
    count = len(gaussians)
    zeros = np.zeros(count, np.uint32)
    return Scene(gaussians, zeros, zeros.copy(), np.zeros(count, np.uint16))


def place_in_world(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    nodes: UInt16[ndarray, " n"],
    poses: Float64[ndarray, "m 4 4"],
) -> tuple[Float32[ndarray, "n 3"], Float32[ndarray, "n 4"]]:
    """Place means and quaternions in the world, given each row's node and world_from_node; background rows stay."""
    if not nodes.any():
        return means, quats
    placed, turned = np.empty(means.shape, np.float32), np.empty(quats.shape, np.float32)
    turns = quaternion_from_matrix(poses[:, :3, :3])
    means, quats, nodes = np.ascontiguousarray(means), np.ascontiguousarray(quats), np.ascontiguousarray(nodes)
    _place_rows(means, quats, nodes, np.ascontiguousarray(poses), turns, placed, turned)
    return placed, turned


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _place_rows(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    nodes: UInt16[ndarray, " n"],
    poses: Float64[ndarray, "m 4 4"],
    turns: Float64[ndarray, "m 4"],
    placed: Float32[ndarray, "n 3"],
    turned: Float32[ndarray, "n 4"],
) -> None:
    """Place each row in float64; those of node 0 stay bit by bit. Quaternions are normalized before they are turned."""
    for row in numba.prange(len(means)):
        node = nodes[row]
        if node == 0:
            for column in range(3):
                placed[row, column] = means[row, column]
            for column in range(4):
                turned[row, column] = quats[row, column]
            continue
        x, y, z = means[row, 0], means[row, 1], means[row, 2]
        for axis in range(3):
            place = poses[node, axis, 0] * x + poses[node, axis, 1] * y + poses[node, axis, 2] * z
            placed[row, axis] = place + poses[node, axis, 3]
        a, b, c, d = quats[row, 0], quats[row, 1], quats[row, 2], quats[row, 3]
        norm = np.sqrt(a * a + b * b + c * c + d * d)
        if norm > np.float32(1e-12):
            a, b, c, d = a / norm, b / norm, c / norm, d / norm
        else:
            a, b, c, d = np.float32(1), np.float32(0), np.float32(0), np.float32(0)
        w, i, j, k = turns[node, 0], turns[node, 1], turns[node, 2], turns[node, 3]
        turned[row, 0] = w * a - i * b - j * c - k * d
        turned[row, 1] = i * a + w * b - k * c + j * d
        turned[row, 2] = j * a + k * b + w * c - i * d
        turned[row, 3] = k * a - j * b + i * c + w * d


def extract_node_rotations(poses: Float64[ndarray, "m 4 4"]) -> Float64[ndarray, "m 3 3"]:
    """Extract the rotations of poses, orthonormalised through quaternions."""
    return matrix_from_quaternion(quaternion_from_matrix(poses[:, :3, :3]))
