"""Points in space behind the sampled pixels of a view, so that a mask can be looked up in another view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.blend_weights import BlendWeights, apply_weights
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import place_in_world
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import CachedView


@dataclass(frozen=True)
class SurfacePoints:
    """Point on a surface behind each sampled pixel of a view."""

    positions: Float64[ndarray, "p 3"]
    """Metres, in the frame of the node."""
    nodes: Int64[ndarray, " p"]
    """0 = background, k = actor k - 1: the node of the Gaussian that contributes most."""

    def pixels_in(
        self, camera: Camera, world_from_node: Float64[ndarray, "m 4 4"], present: Bool[ndarray, " m"]
    ) -> Int64[ndarray, " p"]:
        """Find the flat index of each point's pixel; -1 outside the image or where its actor is absent."""
        matrices = world_from_node[self.nodes]
        world = np.einsum("pij,pj->pi", matrices[:, :3, :3], self.positions) + matrices[:, :3, 3]
        pixels, depths = camera.project(world)
        inside = (depths > 0.1) & (pixels >= 0).all(axis=1) & present[self.nodes]
        inside &= (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        found = np.full(len(world), -1, np.int64)
        columns, rows = pixels[inside].astype(np.int64).T
        found[inside] = rows * camera.width + columns
        return found


def find_surface_points(model: SceneModel, cached: CachedView, camera: Camera, time: float) -> SurfacePoints:
    """Find the point at the blended depth along each sampled pixel's ray."""
    rows = cached.rows.numpy()
    nodes = model.nodes[rows]
    world_from_node = model.actor_poses.at(time, model.corrections, camera.lag).matrices
    means, quats = (model.parameters[name].detach().numpy()[rows] for name in ("means", "quats"))
    means, _ = place_in_world(means, quats, nodes, world_from_node)
    depths = camera.project(means)[1]
    blended = apply_weights(cached.weights, np.stack([depths, np.ones(len(rows))], axis=1).astype(np.float32))
    rays = camera.compute_pixel_rays(cached.pixels)
    reach = blended[:, 0] / blended[:, 1] / (rays @ camera.world_from_camera[:3, 2])
    world = camera.position + rays * reach[:, None]
    owners = nodes[_find_strongest(cached.weights)].astype(np.int64)
    matrices = world_from_node[owners]
    local = np.einsum("pji,pj->pi", matrices[:, :3, :3], world - matrices[:, :3, 3])
    return SurfacePoints(local, owners)


def _find_strongest(weights: BlendWeights) -> Int[ndarray, " p"]:
    """Find the row with the largest weight in each pixel; every pixel has at least one."""
    starts = weights.indptr[:-1]
    if not len(starts):
        return np.zeros(0, np.int64)
    largest = np.repeat(np.maximum.reduceat(weights.weights, starts), np.diff(weights.indptr))
    places = np.where(weights.weights == largest, np.arange(len(largest)), len(largest))
    return weights.rows[np.minimum.reduceat(places, starts)]
