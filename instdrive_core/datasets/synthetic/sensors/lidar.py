"""A spinning LiDAR by ray casting. The whole turn sees the street as it is at its time step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, UInt8, UInt32
from numpy import ndarray

from instdrive_core.datasets.synthetic.sensors.raytrace import Rays
from instdrive_core.datasets.synthetic.world.materials import MaterialTable
from instdrive_core.datasets.synthetic.world.rig import LIDAR_BLIND_RANGE, LIDAR_RANGE
from instdrive_core.datasets.synthetic.world.street import StepGeometry

RANGE_NOISE = 0.02
"""Standard deviation of measured ranges in metres."""


@dataclass(frozen=True)
class LidarSweep:
    """Returns of one turn, in the street's frame."""

    points: Float64[ndarray, "n 3"]
    intensities: Float64[ndarray, " n"]
    """Whole numbers from 0 to 255."""
    classes: UInt8[ndarray, " n"]
    """PandaSet's semantic classes."""
    instances: UInt32[ndarray, " n"]


def cast_sweep(
    rays: Rays,
    geometry: StepGeometry,
    materials: MaterialTable,
    semantics: UInt8[ndarray, " ids"],
    street_from_lidar: Float64[ndarray, "4 4"],
    beams: Float32[ndarray, "rays 3"],
    rng: np.random.Generator,
) -> LidarSweep:
    """One turn of the LiDAR at a pose.

    Args:
        beams: unit directions in the LiDAR's frame.
        semantics: class by instance ID; a material's own class goes before it (paint on the road).
    """
    directions = beams @ street_from_lidar[:3, :3].T.astype(np.float32)
    origin = street_from_lidar[:3, 3]
    hits = rays.find_first_hits(np.broadcast_to(origin.astype(np.float32), directions.shape).copy(), directions)
    seen = (hits.triangles >= 0) & (hits.distances > LIDAR_BLIND_RANGE) & (hits.distances < LIDAR_RANGE)
    triangles, directions = hits.triangles[seen], directions[seen].astype(np.float64)
    distances = hits.distances[seen].astype(np.float64)
    measured = distances + RANGE_NOISE * rng.standard_normal(len(distances))
    hit_materials = geometry.mesh.materials[triangles]
    owners = geometry.instances[triangles]
    own_class = materials.semantics[hit_materials]
    return LidarSweep(
        origin + measured[:, None] * directions,
        _compute_intensities(geometry, triangles, directions, distances, materials.parameters[hit_materials, 10], rng),
        np.where(own_class > 0, own_class, semantics[owners]),
        owners.astype(np.uint32),
    )


def _compute_intensities(
    geometry: StepGeometry, triangles: ndarray, directions: ndarray, distances: ndarray,
    reflectivity: ndarray, rng: np.random.Generator,
) -> Float64[ndarray, " n"]:  # fmt: skip
    """Reflectivity times a half-Lambertian falloff, with speckle; range is compensated, as sensors report it."""
    corners = geometry.mesh.corners[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosines = np.abs((normals * directions).sum(axis=1)) / np.linalg.norm(normals, axis=1)
    fading = np.exp(-distances / 180)
    speckle = 1 + 0.12 * rng.standard_normal(len(distances))
    return np.clip(np.round(255 * reflectivity * (0.35 + 0.65 * cosines) * fading * speckle), 0, 255)
