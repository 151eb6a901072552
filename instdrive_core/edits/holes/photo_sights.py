"""What photos show of a thing and around it, and what each would show without the thing.

That depends on the splats as the photos saw them, and hardly on what was edited since: a report on a deletion and the
fill that follows it look at the photos once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC, find_learned
from instdrive_core.rasterize.kernels.blend_weights import BlendWeights, apply_weights, weigh_projected
from instdrive_core.rasterize.kernels.project import Projection, project
from instdrive_core.rasterize.kernels.settings import RasterSettings, choose_raster_settings
from instdrive_core.scene.camera import Camera, CameraView, PhotoLag
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.scene.transforms import copy_shapes_at_home

OWN_SHARE = 0.4
"""Share of a pixel's light from which it shows the thing."""
RIM = 1
"""Pixels around a silhouette that may show it, too."""
SKY_COVER = 0.5
"""Share of a pixel's light that splats stop, at most, where it shows the sky."""
NEAR_SHARE = 0.02
"""Share of the thing's splats that may lie nearer than where it begins."""
_BESIDE, _INSIDE, _NEITHER = range(3)


@dataclass(frozen=True)
class PhotoSight:
    """The part of one photo around a thing."""

    camera: Camera
    time: float
    silhouette: Bool[ndarray, "h w"]
    """Pixels that show the thing, and a rim around them."""
    nearest: float
    """Metres along the viewing axis to where the thing begins."""
    reach: Int32[ndarray, " v"]
    """Rows, rising, that lie before the camera within that part, hidden or not."""
    rows: Int64[ndarray, " k"]
    """Rows, rising, of which the photo shows something."""
    beside: Float64[ndarray, " k"]
    """Pixels that each fills outside of the silhouette …"""
    inside: Float64[ndarray, " k"]
    """… and in pixels that show the thing."""
    behind: BlendWeights
    """What the pixels of the silhouette, row-major, would show without the thing."""
    sky: Bool[ndarray, "h w"]
    """Pixels that show the sky: splats stop at most half of the light there."""


class PhotographedSplats:
    """A document's splats where the photos saw them: whatever was deleted is there, whatever was moved is back."""

    def __init__(self, document: Document, own: Int64[ndarray, " k"], kept: Int64[ndarray, " m"]) -> None:
        """`own` are rows of the thing in question, `kept` those that are left of it."""
        scene = document.scene
        self.scene: Scene = scene
        self.shapes: Gaussians = copy_shapes_at_home(scene.gaussians, document.transforms)
        self.opacities: Float32[ndarray, " n"] = self.shapes.opacities
        self.settings: RasterSettings = choose_raster_settings(scene)
        self.own: Bool[ndarray, " n"] = _mark(len(scene), own)
        self.shown: Bool[ndarray, " n"] = np.ones(len(scene), bool)
        """Rows that photos may show: all but those that were made since, unless the thing is made of them."""
        if SYNTHETIC in scene.extra:
            self.shown = find_learned(scene) | self.own
        self._parts: Float32[ndarray, "n 2"] = np.stack([self.own, self.own | _mark(len(scene), kept)], 1).astype(
            np.float32
        )
        self._ones = np.ones((len(scene), 1), np.float32)
        self._placed: tuple[tuple[float, PhotoLag | None], tuple[ndarray, ndarray, ndarray]] | None = None

    def look(self, view: CameraView, camera: Camera) -> PhotoSight:
        """Look at a part of a photo, of which `camera` is the camera, with and without the thing."""
        pixels = np.arange(camera.width * camera.height)
        projection = self._project(view.time, camera, None)
        full = weigh_projected(projection, camera, pixels, self.settings)
        shares = apply_weights(full, self._parts).reshape(camera.height, camera.width, 2) >= OWN_SHARE
        shown, bodies = shares[..., 0], shares[..., 1]
        silhouette = np.asarray(ndimage.binary_dilation(shown, iterations=RIM), bool)
        sky = apply_weights(full, self._ones)[:, 0].reshape(silhouette.shape) < SKY_COVER
        kinds = np.full(silhouette.shape, _NEITHER, np.uint8)
        kinds[~silhouette & ~bodies] = _BESIDE
        kinds[shown] = _INSIDE  # what lies on its rim shows nothing
        sums = np.zeros((2, len(self.own)))
        _sum_by_row(full.indptr, full.rows, full.weights, kinds.ravel(), sums)
        rows = np.flatnonzero(sums.any(axis=0))
        without = projection.select(~self.own[projection.rows])
        behind = weigh_projected(without, camera, np.flatnonzero(silhouette), self.settings)
        return PhotoSight(
            camera, view.time, silhouette, self._find_nearest(view.time, camera), np.sort(projection.rows),
            rows, sums[_BESIDE, rows], sums[_INSIDE, rows], behind, sky,
        )  # fmt: skip

    def weigh_behind(self, sight: PhotoSight, standing: Bool[ndarray, " n"]) -> BlendWeights:
        """What the pixels of the silhouette show of the rows that are `standing` now, without the thing.

        Only pixels that show anything else than in the photos are looked at again: the others have the same bits.
        """
        behind = sight.behind
        gone, added = self.shown & ~standing, np.flatnonzero(standing & ~self.shown)
        arrived = self._project(sight.time, sight.camera, added).rows if len(added) else added
        if len(arrived):
            changed = np.ones(len(behind.indptr) - 1, bool)
        else:
            changed = np.zeros(len(behind.indptr) - 1, bool)
            changed[np.searchsorted(behind.indptr, np.flatnonzero(gone[behind.rows]), "right") - 1] = True
        if not changed.any():
            return behind
        rows = np.union1d(sight.reach, added[arrived]) if len(arrived) else sight.reach
        rows = rows[standing[rows] & ~self.own[rows]]
        pixels = np.flatnonzero(sight.silhouette)[changed]
        again = weigh_projected(self._project(sight.time, sight.camera, rows), sight.camera, pixels, self.settings)
        return behind.replace_pixels(
            changed, BlendWeights(again.indptr, rows[again.rows].astype(np.int32), again.weights)
        )

    def _project(self, time: float, camera: Camera, rows: Int64[ndarray, " k"] | None) -> Projection:
        """Project what the photos show, or some rows, whose places among these the projection then names."""
        if rows is None:
            means, quats, opacities = self._place(time, camera.lag)
            return project(means, quats, self.shapes.log_scales, opacities, camera, self.settings)
        poses, present = self.scene.find_node_poses(time, camera.lag)
        nodes = self.scene.nodes[rows]
        means, quats = place_in_world(self.shapes.means[rows], self.shapes.quats[rows], nodes, poses)
        opacities = np.where(present[nodes], self.opacities[rows], np.float32(0))
        return project(means, quats, self.shapes.log_scales[rows], opacities, camera, self.settings)

    def _place(
        self, time: float, lag: PhotoLag | None
    ) -> tuple[Float32[ndarray, "n 3"], Float32[ndarray, "n 4"], Float32[ndarray, " n"]]:
        """Means, quaternions and opacities of what the photos show at `time` (s): several cameras show one moment."""
        if self._placed is None or self._placed[0] != (time, lag):
            poses, present = self.scene.find_node_poses(time, lag)
            nodes = self.scene.nodes
            means, quats = place_in_world(self.shapes.means, self.shapes.quats, nodes, poses)
            opacities = np.where(present[nodes] & self.shown, self.opacities, np.float32(0))
            self._placed = (time, lag), (means, quats, opacities)
        return self._placed[1]

    def _find_nearest(self, time: float, camera: Camera) -> float:
        forward = camera.camera_from_world[2]
        return float(np.quantile(self._place(time, camera.lag)[0][self.own] @ forward[:3] + forward[3], NEAR_SHARE))


def _mark(count: int, rows: Int64[ndarray, " k"]) -> Bool[ndarray, " n"]:
    marks = np.zeros(count, bool)
    marks[rows] = True
    return marks


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sum_by_row(
    indptr: Int64[ndarray, " p+1"],
    rows: Int32[ndarray, " m"],
    weights: Float32[ndarray, " m"],
    kinds: UInt8[ndarray, " p"],
    sums: Float64[ndarray, "k n"],
) -> None:
    """Add the weights of each splat in the pixels of each kind, in the order of the pixels."""
    for pixel in range(len(kinds)):
        kind = kinds[pixel]
        if kind < len(sums):
            for entry in range(indptr[pixel], indptr[pixel + 1]):
                sums[kind, rows[entry]] += weights[entry]
