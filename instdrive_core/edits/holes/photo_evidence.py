"""What the photos say about a deleted thing: where it hid what is behind, and which splats no photo ever reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC
from instdrive_core.edits.queries.photo_parts import NEAREST, choose_apart, cut_camera
from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.kernels.blend_weights import BlendWeights, weigh_projected
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import project
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import copy_at_home, find_away

MAX_LOOKS, MAX_WITNESSES = 10, 8
"""Photos that are asked: those that show most of the thing, and those that show most of what these did not reach."""
MIN_PIXELS = 60
"""Pixels of a photo, at full size, that the thing must span to be looked at."""
AROUND = 2.5
"""Metres around the thing that are looked at."""
MAX_PIXELS = 8000
"""Pixels of that part; it is made smaller where it has more."""
OWN_SHARE = 0.4
"""Share of a pixel's light from which it shows the thing."""
RIM = 1
"""Pixels around a silhouette that may show it, too."""
MIN_WEIGHT = 0.25
"""Pixels that a splat must fill, over all looks, to be judged."""
REACHED_SHARE = 0.5
"""Share of what a photo would show of a splat without the thing that it must show with the thing …"""
MIN_REACHING = 2
"""… in so many looks for the splat to have been seen."""
NEAR_SHARE = 0.02
"""Share of the thing's splats that may lie nearer than where it begins."""
MIN_COVER = 0.7
"""Share of light that what stands behind the thing must stop."""
EXPLAINED_SHARE = 0.6
"""Share of what photos show of a splat that must lie in the thing's silhouette for it to be the thing's."""


@dataclass(frozen=True)
class Look:
    """The part of one photo around the thing."""

    camera: Camera
    time: float
    silhouette: Bool[ndarray, "h w"]
    """Pixels that show the thing, and a rim around them."""
    open: Bool[ndarray, "h w"]
    """Pixels of the silhouette that too little covers once the thing and all that no photo reached is gone."""
    nearest: float
    """Metres along the viewing axis to where the thing begins."""


@dataclass(frozen=True)
class PhotoEvidence:
    """What the photos that show a thing say about the splats around it."""

    looks: tuple[Look, ...]
    """Those that show most first."""
    unseen: Int64[ndarray, " u"]
    """Rows, rising, that would show where the thing stood, and that no photo reached."""
    seen: Int64[ndarray, " s"]
    """Rows, rising, that would show there, and that photos reached past the thing."""
    explained: Int64[ndarray, " e"]
    """Rows, rising, that photos show only within the silhouette of the thing."""

    @property
    def gap_share(self) -> float:
        """Share of the silhouettes' pixels that are open."""
        return float(np.mean(np.concatenate([look.open[look.silhouette] for look in self.looks])))

    @property
    def lost(self) -> Int64[ndarray, " l"]:
        """Rows, rising, that do not count for what stands there."""
        return np.union1d(self.unseen, self.explained)


def gather_photo_evidence(
    document: Document, groups: Sequence[Int64[ndarray, "_"]], kept: Sequence[Int64[ndarray, "_"]] = ()
) -> PhotoEvidence | None:
    """Compare the photos' views with and without groups of rows, deleted or not, each of one thing.

    `kept` are rows of the same things that stay: what shines through them was not seen past the thing. Things that
    move hid nothing for long, so they are left out; None where nothing is left, or there are no photos. Whatever was
    moved by hand is where the photos saw it.
    """
    scene = document.scene
    still = [rows for rows in groups if len(rows) and np.count_nonzero(scene.nodes[rows]) < len(rows) / 2]
    rows = np.unique(np.concatenate([np.zeros(0, np.int64), *still]))
    rows = rows[scene.nodes[rows] == 0]
    solid = rows[sigmoid(scene.gaussians.opacity_logits[rows]) >= OWN_SHARE]
    if not len(solid) or not scene.views:
        return None
    points = copy_at_home(scene.gaussians, document.transforms, solid).means.astype(np.float64)
    chosen = _choose_views(scene.views, points)
    if not chosen:
        return None
    standing = (document.state.flags & Flag.DELETED) == 0
    standing[rows] = True
    alive = np.flatnonzero(standing)
    drawn = copy_at_home(scene.gaussians, document.transforms, alive)
    own = np.isin(alive, rows, assume_unique=True)
    tally = _Tally(len(alive), own | np.isin(alive, np.concatenate([np.zeros(0, np.int64), *kept])))
    looks = [tally.add(document, view, camera, drawn, alive, own) for view, camera in _sort_by_time(chosen)]
    doubted = np.flatnonzero(
        (tally.uncovered >= MIN_WEIGHT) & (tally.reaching < MIN_REACHING) & (scene.nodes[alive] == 0)
    )
    witnesses = _choose_witnesses(scene.views, drawn.means[doubted].astype(np.float64), chosen)
    for view, camera in _sort_by_time(witnesses):
        tally.add(document, view, camera, drawn, alive, own)
    movable = (scene.nodes[alive] == 0) & ~own & ((document.state.flags[alive] & Flag.LOCKED) == 0)
    movable &= ~find_away(document.transforms, alive)
    if SYNTHETIC in scene.extra:
        movable &= scene.extra[SYNTHETIC][alive] == 0
    uncovered = movable & (tally.uncovered >= MIN_WEIGHT)
    reached = tally.reaching >= MIN_REACHING
    inside = tally.explained >= EXPLAINED_SHARE * (tally.explained + tally.beside)
    explained = movable & ~reached & inside & (tally.explained >= MIN_WEIGHT)
    unseen = uncovered & ~reached
    looks = [tally.open_look(number, look, unseen | explained) for number, look in enumerate(looks)]
    sizes = [int(look.silhouette.sum()) for look in looks]
    looks = tuple(looks[place] for place in np.argsort(sizes, kind="stable")[::-1].tolist() if sizes[place])
    return PhotoEvidence(looks, alive[unseen], alive[uncovered & reached], alive[explained]) if looks else None


class _Tally:
    """Sums over looks, a number per splat that is drawn; `body` is what belongs to the things, kept parts included."""

    def __init__(self, count: int, body: Bool[ndarray, " n"]) -> None:
        self.body = body
        self.beside = np.zeros(count)
        self.explained = np.zeros(count)
        self.uncovered = np.zeros(count)
        self.reaching = np.zeros(count, np.int64)
        self.left: list[BlendWeights] = []
        self.placed: tuple[float, tuple[ndarray, ndarray, ndarray]] | None = None
        """The last moment and what `_place` found: photos of several cameras show the same one."""

    def add(
        self,
        document: Document,
        view: CameraView,
        camera: Camera,
        drawn: Gaussians,
        alive: Int64[ndarray, " n"],
        own: Bool[ndarray, " n"],
    ) -> Look:
        """Look with and without the thing, whose splats are `own`."""
        scene = document.scene
        if self.placed is None or self.placed[0] != view.time:
            self.placed = view.time, _place(scene, drawn, alive, view.time)
        placed, turned, solid = self.placed[1]
        pixels, settings = np.arange(camera.width * camera.height), choose_raster_settings(scene)
        sizes = to_kernel_array(drawn.log_scales)
        projection = project(placed, turned, sizes, solid, camera, settings)
        full = weigh_projected(projection, camera, pixels, settings)
        shares = _sum_by_pixel(full, np.where(own[full.rows], full.weights, 0))
        shown = (shares >= OWN_SHARE).reshape(camera.height, camera.width)
        silhouette = np.asarray(ndimage.binary_dilation(shown, iterations=RIM), bool)
        hidden = np.flatnonzero(silhouette)
        gone = weigh_projected(projection.select(~own[projection.rows]), camera, hidden, settings)
        self.left.append(gone)
        uncovered = np.bincount(gone.rows, gone.weights, len(alive))
        bodies = _sum_by_pixel(full, np.where(self.body[full.rows], full.weights, 0)) >= OWN_SHARE
        beside = _sum_by_row(full, ~silhouette & ~bodies.reshape(silhouette.shape), len(alive))
        self.beside += beside
        self.explained += _sum_by_row(full, shown, len(alive))  # what lies on its rim shows nothing
        self.uncovered += uncovered
        self.reaching += (beside >= REACHED_SHARE * (beside + uncovered)) & (beside >= MIN_WEIGHT / 2)
        forward = camera.camera_from_world[2]
        depths = placed[own] @ forward[:3] + forward[3]
        nearest = float(np.quantile(depths, NEAR_SHARE))
        return Look(camera, view.time, silhouette, np.zeros_like(silhouette), nearest)

    def open_look(self, number: int, look: Look, lost: Bool[ndarray, " n"]) -> Look:
        """The look with what is open in it once the `lost` splats are gone, too."""
        left, opened = self.left[number], look.open.copy()
        covers = _sum_by_pixel(left, np.where(lost[left.rows], 0, left.weights))
        opened[look.silhouette] = covers < MIN_COVER
        return replace(look, open=opened)


def _sort_by_time(views: Sequence[tuple[CameraView, Camera]]) -> list[tuple[CameraView, Camera]]:
    return sorted(views, key=lambda each: each[0].time)


def _place(
    scene: Scene, drawn: Gaussians, alive: Int64[ndarray, " n"], time: float
) -> tuple[Float32[ndarray, "n 3"], Float32[ndarray, "n 4"], Float32[ndarray, " n"]]:
    """Means, quaternions and opacities of the rows `alive` at `time` (s)."""
    poses, present = scene.find_node_poses(time)
    nodes = scene.nodes[alive]
    means, quats = place_in_world(drawn.means, drawn.quats, nodes, poses)
    opacities = np.where(present[nodes], drawn.opacities, np.float32(0))
    return to_kernel_array(means), to_kernel_array(quats), to_kernel_array(opacities)


def _sum_by_row(found: BlendWeights, chosen: Bool[ndarray, "h w"], count: int) -> Float64[ndarray, " n"]:
    """Weights of each of `count` splats in the chosen pixels."""
    entries = np.repeat(chosen.ravel(), np.diff(found.indptr))
    return np.bincount(found.rows[entries], found.weights[entries], count).astype(np.float64)


def _sum_by_pixel(found: BlendWeights, values: ndarray) -> Float64[ndarray, " p"]:
    pixels = np.repeat(np.arange(len(found.indptr) - 1), np.diff(found.indptr))
    return np.bincount(pixels, values, len(found.indptr) - 1).astype(np.float64)


def _choose_views(views: Sequence[CameraView], points: Float64[ndarray, "k 3"]) -> list[tuple[CameraView, Camera]]:
    """Views that show most of the points, and the cameras of the parts of them that do."""
    found = []
    for view in views:
        camera = _crop_camera(view.camera, points)
        if camera is not None:
            found.append((camera[1], view, camera[0]))
    return choose_apart(found, MAX_LOOKS)


def _choose_witnesses(
    views: Sequence[CameraView], points: Float64[ndarray, "k 3"], chosen: Sequence[tuple[CameraView, Camera]]
) -> list[tuple[CameraView, Camera]]:
    """Further views, which may not show the thing at all, of points that the chosen ones did not reach past it."""
    found = []
    taken = [view for view, _ in chosen]
    for view in views:
        pixels, depths = view.camera.project(points)
        framed = view.camera.contains(pixels, depths, NEAREST)
        if framed.sum() > max(0.05 * len(points), 3) and not any(view is other for other in taken):
            found.append((int(framed.sum()), view, cut_camera(view.camera, pixels[framed], MAX_PIXELS)))
    return choose_apart(found, MAX_WITNESSES, taken)


def _crop_camera(camera: Camera, points: Float64[ndarray, "k 3"]) -> tuple[Camera, float] | None:
    """The camera of the part of a photo around points, and how many pixels they span; None where it shows too few."""
    pixels, depths = camera.project(points)
    framed = camera.contains(pixels, depths, NEAREST)
    if np.count_nonzero(framed) < max(0.1 * len(points), 3):
        return None
    span = float(np.prod(np.ptp(pixels[framed], axis=0)))
    if span < MIN_PIXELS:
        return None
    steps = AROUND * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    around, away = camera.project((points[:: 1 + len(points) // 1000, None] + steps).reshape(-1, 3))
    around = np.clip(around[away > NEAREST], 0, [camera.width, camera.height])
    return cut_camera(camera, np.concatenate([pixels[framed], around]), MAX_PIXELS), span
