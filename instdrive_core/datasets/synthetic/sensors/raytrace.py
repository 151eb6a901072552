"""Ray casting on triangles by Embree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float32, Int32
from numpy import ndarray


@runtime_checkable
class Rays(Protocol):
    """Something to cast rays at. Casting from several threads at once is safe and parallel."""

    def find_first_hits(self, origins: Float32[ndarray, "n 3"], directions: Float32[ndarray, "n 3"]) -> Hits:
        """The nearest hit of each ray; directions are unit vectors."""
        ...

    def find_occluded(
        self, origins: Float32[ndarray, "n 3"], directions: Float32[ndarray, "n 3"], reach: float
    ) -> Bool[ndarray, " n"]:
        """Whether anything lies within `reach` metres along each ray."""
        ...


@dataclass(frozen=True)
class Hits:
    """Nearest triangles along n rays."""

    triangles: Int32[ndarray, " n"]
    """Row of the triangle; −1 where the ray leaves the scene."""
    u: Float32[ndarray, " n"]
    v: Float32[ndarray, " n"]
    """Barycentric weights of the second and third corner."""
    distances: Float32[ndarray, " n"]
    """Metres along the unit direction."""


class RayScene:
    """The triangles of one time step, ready for rays. Casting from several threads at once is safe and parallel."""

    def __init__(self, corners: Float32[ndarray, "n 3 3"]) -> None:
        self._scene = EmbreeScene()
        self._mesh = EmbreeMesh(self._scene, np.ascontiguousarray(corners, np.float32))
        self.find_occluded(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32), 1.0)  # builds the tree now

    def find_first_hits(self, origins: Float32[ndarray, "n 3"], directions: Float32[ndarray, "n 3"]) -> Hits:
        """The nearest hit of each ray; directions are unit vectors."""
        found = self._scene.run(origins, directions, output=True)
        return Hits(found["primID"], found["u"], found["v"], found["tfar"])

    def find_occluded(
        self, origins: Float32[ndarray, "n 3"], directions: Float32[ndarray, "n 3"], reach: float
    ) -> Bool[ndarray, " n"]:
        """Whether anything lies within `reach` metres along each ray."""
        limits = np.full(len(origins), reach, np.float32)
        return self._scene.run(origins, directions, dists=limits, query="OCCLUDED") >= 0


@dataclass(frozen=True)
class LayeredRays:
    """Two sets of triangles as one, so that what stands still need not be built again. The second's rows follow the
    first's `count`."""

    first: Rays
    count: int
    second: Rays

    def find_first_hits(self, origins: Float32[ndarray, "n 3"], directions: Float32[ndarray, "n 3"]) -> Hits:
        """The nearest hit of each ray; directions are unit vectors."""
        one, two = (layer.find_first_hits(origins, directions) for layer in (self.first, self.second))
        nearer = (two.triangles >= 0) & ((one.triangles < 0) | (two.distances < one.distances))
        triangles = np.where(nearer, two.triangles + np.int32(self.count), one.triangles).astype(np.int32)
        chosen = (np.where(nearer, b, a) for a, b in zip(_barycentric(one), _barycentric(two), strict=True))
        return Hits(triangles, *chosen)

    def find_occluded(
        self, origins: Float32[ndarray, "n 3"], directions: Float32[ndarray, "n 3"], reach: float
    ) -> Bool[ndarray, " n"]:
        """Whether anything lies within `reach` metres along each ray."""
        hidden = self.first.find_occluded(origins, directions, reach)
        return hidden | self.second.find_occluded(origins, directions, reach)


def _barycentric(hits: Hits) -> tuple[ndarray, ndarray, ndarray]:
    return hits.u, hits.v, hits.distances
