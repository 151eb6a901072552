"""Photos and exact label maps of one time step by ray tracing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8, UInt16
from numpy import ndarray

from instdrive_core.datasets.synthetic.sensors.raytrace import Rays, RayScene
from instdrive_core.datasets.synthetic.world.light import (
    SIDE,
    SUBSAMPLES,
    Light,
    compute_hit_geometry,
    compute_probe_directions,
    develop_photo,
    shade_hits,
    shade_sky,
)
from instdrive_core.datasets.synthetic.world.materials import MaterialTable
from instdrive_core.datasets.synthetic.world.street import StepGeometry
from instdrive_core.scene.camera import Camera

EXPOSURE = 0.62
SHADOW_REACH = 150.0
MAX_RAYS = 2**19
"""Cast at once; a photo of 480×270 needs as many."""
OPEN_REACH = 1.8
"""Metres within which something else takes ambient light away."""


@dataclass(frozen=True)
class RenderedPhoto:
    """Photo and labels that a camera records."""

    image: UInt8[ndarray, "h w 3"]
    labels: UInt16[ndarray, "h w"]
    """Instance ID that most of a pixel shows; 0 = sky."""


class StepRenderer:
    """One time step, ready to be photographed. Threads may share it."""

    def __init__(
        self, geometry: StepGeometry, materials: MaterialTable, light: Light, rays: Rays | None = None
    ) -> None:
        self.geometry, self.materials, self.light = geometry, materials, light
        self.rays = RayScene(geometry.mesh.corners) if rays is None else rays

    def photograph(self, camera: Camera, exposure: float = EXPOSURE) -> RenderedPhoto:
        """The view of a camera that is posed in the street's frame; taken in bands that bound memory."""
        image = np.empty((camera.height, camera.width, 3), np.uint8)
        labels = np.empty((camera.height, camera.width), np.uint16)
        band = max(1, MAX_RAYS // (SUBSAMPLES * camera.width))
        for top in range(0, camera.height, band):
            rows = slice(top, min(top + band, camera.height))
            self.expose(camera, rows, exposure, image[rows].reshape(-1, 3), labels[rows].reshape(-1))
        return RenderedPhoto(image, labels)

    def expose(
        self,
        camera: Camera,
        rows: slice,
        exposure: float,
        image: UInt8[ndarray, "n 3"],
        labels: UInt16[ndarray, " n"],
    ) -> None:
        """Fill `image` and `labels` with the pixels of some rows."""
        mesh, light = self.geometry.mesh, self.light
        directions = compute_subsample_directions(camera, rows)
        origin = camera.position.astype(np.float32)
        hits = self.rays.find_first_hits(np.broadcast_to(origin, directions.shape).copy(), directions)
        struck = np.flatnonzero(hits.triangles >= 0)
        points, normals = np.empty((len(struck), 3), np.float32), np.empty((len(struck), 3), np.float32)
        compute_hit_geometry(struck, hits.triangles, hits.distances, origin, directions, mesh.corners, points, normals)
        to_light, to_open = np.empty_like(points), np.empty_like(points)
        compute_probe_directions(struck, normals, light.sun_directions(), to_light, to_open)
        in_shadow = self.rays.find_occluded(points, to_light, SHADOW_REACH)
        enclosed = self.rays.find_occluded(points, to_open, OPEN_REACH)
        radiance = np.empty_like(directions)
        shade_hits(
            struck, hits.triangles, hits.u, hits.v, hits.distances, directions, normals, mesh.texcoords, mesh.normals,
            mesh.materials, self.materials.parameters, in_shadow, enclosed, light.to_sun, light.cloud_seed,
            light.haze, 1.0 / camera.fx, radiance,
        )  # fmt: skip
        shade_sky(hits.triangles, directions, light.to_sun, light.cloud_seed, radiance)
        ids = np.where(hits.triangles >= 0, self.geometry.instances[hits.triangles], 0)
        develop_photo(radiance, ids, exposure, image, labels)


def compute_subsample_directions(camera: Camera, rows: slice) -> Float32[ndarray, "n 3"]:
    """Unit directions of all subsamples of some pixel rows, pixel by pixel, in the frame of the camera's pose."""
    fractions = (np.arange(SIDE) + 0.5) / SIDE
    x = ((np.arange(camera.width)[:, None] + fractions) - camera.cx) / camera.fx
    y = ((np.arange(rows.start, rows.stop)[:, None] + fractions) - camera.cy) / camera.fy
    local = np.empty((len(y), camera.width, SIDE, SIDE, 3), np.float32)
    local[..., 0] = x[None, :, None, :]
    local[..., 1] = y[:, None, :, None]
    local[..., 2] = 1.0
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return (local.reshape(-1, 3) @ camera.world_from_camera[:3, :3].T.astype(np.float32)).astype(np.float32)
