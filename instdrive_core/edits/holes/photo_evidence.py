"""What the photos say about a deleted thing: where it hid what is behind, and which splats no photo ever reached."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import Part, fingerprint
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC
from instdrive_core.edits.holes.photo_sights import OWN_SHARE, PhotographedSplats, PhotoSight
from instdrive_core.edits.queries.photo_parts import NEAREST, choose_apart, choose_covering, cut_camera
from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.kernels.blend_weights import BlendWeights, apply_weights
from instdrive_core.scene.camera import Camera, CameraView, PhotoLag
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import find_away

MAX_LOOKS, MAX_WITNESSES = 10, 8
"""Photos that are asked: those that show most of the thing, and those that show most of what these did not reach."""
MIN_PIXELS = 60
"""Pixels of a photo, at full size, that the thing must span to be looked at."""
AROUND = 2.5
"""Metres around the thing that are looked at."""
MAX_PIXELS = 8000
"""Pixels of that part; it is made smaller where it has more."""
MIN_WEIGHT = 0.25
"""Pixels that a splat must fill, over all looks, to be judged."""
REACHED_SHARE = 0.5
"""Share of what a photo would show of a splat without the thing that it must show with the thing …"""
MIN_REACHING = 2
"""… in so many looks for the splat to have been seen. One is enough for it to stay …"""
CLOSE = 0.5
"""… so many metres from the thing, where nothing of the thing itself can be."""
HIDDEN_SHARE = 0.1
"""Pixels in which photos show a splat that is hidden, at most, for each that it would fill without the thing."""
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
    """Pixels of the silhouette that too little covers once the thing and all that no photo reached is gone. What moves
    leaves those out beside which, left or right, the photo shows the sky at the same height."""
    nearest: float
    """Metres along the viewing axis to where the thing begins."""
    place: Float64[ndarray, "3"]
    """The middle of the thing at that time, metres in the world."""
    walled: Bool[ndarray, "h w"]
    """Open pixels above which the photo shows what goes on there, and no sky above them or beside."""


@dataclass(frozen=True)
class PhotoRecord:
    """The photos that say most about a thing, as they were taken."""

    key: bytes
    """Digest of the splats, the photos and the thing."""
    sights: tuple[PhotoSight, ...]
    """Those that show most of the thing, then those that show most of what these did not reach."""
    look_count: int
    """How many are of the first kind."""


@dataclass(frozen=True)
class PhotoEvidence:
    """What the photos that show a thing say about the splats around it."""

    looks: tuple[Look, ...]
    """Those that show most first."""
    unseen: Int64[ndarray, " u"]
    """Rows, rising, that would show where the thing stood, and that no photo reached. None of what moves is told: other
    photos than these show what is around its way."""
    seen: Int64[ndarray, " s"]
    """Rows, rising, that would show there, and that photos reached past the thing."""
    hidden: Int64[ndarray, " h"]
    """Those of the unseen of which photos show hardly anything: not even at the rim of the thing."""
    explained: Int64[ndarray, " e"]
    """Rows, rising, that photos show only within the silhouette of the thing."""
    record: PhotoRecord
    """What of this holds for the same things whatever else is deleted."""

    @property
    def gap_share(self) -> float:
        """Share of the silhouettes' pixels that are open."""
        return float(np.mean(np.concatenate([look.open[look.silhouette] for look in self.looks])))

    @property
    def walled_share(self) -> float:
        """Share of the silhouettes' pixels that are open though a wall would go on there."""
        return float(np.mean(np.concatenate([look.walled[look.silhouette] for look in self.looks])))

    @property
    def lost(self) -> Int64[ndarray, " l"]:
        """Rows, rising, that do not count for what stands there."""
        return np.union1d(self.unseen, self.explained)


def gather_photo_evidence(
    document: Document,
    groups: Sequence[Int64[ndarray, "_"]],
    kept: Sequence[Int64[ndarray, "_"]] = (),
    record: PhotoRecord | None = None,
    leaving: Int64[ndarray, "_"] | None = None,
) -> PhotoEvidence | None:
    """Compare the photos' views with and without groups of rows, deleted or not, each of one thing.

    `kept` are rows of the same things that stay: what shines through them was not seen past the thing. Beside things
    that stand still those that move are left out; None where nothing is left, or there are no photos. Whatever was
    moved by hand is where the photos saw it. Rows that are `leaving` count as deleted already. A `record` of the same
    things is used where it still holds: what it tells is the same, to the last bit.
    """
    scene = document.scene
    rows = _choose_rows(scene, groups)
    if not scene.views or not (sigmoid(scene.gaussians.opacity_logits[rows]) >= OWN_SHARE).any():
        return None
    left = np.unique(np.concatenate([np.zeros(0, np.int64), *kept]))
    key = _fingerprint_photos(document, rows, left)
    photographed = PhotographedSplats(document, rows, left)
    if record is None or record.key != key:
        record = _make_record(photographed, rows, key)
    standing = (document.state.flags & Flag.DELETED) == 0
    if leaving is not None:
        standing[leaving] = False
    standing[rows] = True
    behind = [photographed.weigh_behind(sight, standing) for sight in record.sights]
    tally = _Tally(len(scene))
    for sight, weights in zip(record.sights, behind, strict=True):
        tally.add(sight, weights)
    movable = standing & (scene.nodes == 0) & ~photographed.own & ((document.state.flags & Flag.LOCKED) == 0)
    movable &= ~find_away(document.transforms, np.arange(len(scene)))
    if SYNTHETIC in scene.extra:
        movable &= scene.extra[SYNTHETIC] == 0
    uncovered = movable & (tally.uncovered >= MIN_WEIGHT)
    reached = tally.reaching >= MIN_REACHING
    inside = tally.explained >= EXPLAINED_SHARE * (tally.explained + tally.beside)
    explained = movable & ~reached & inside & (tally.explained >= MIN_WEIGHT)
    unseen = uncovered & ~reached
    once = np.flatnonzero(unseen & (tally.reaching > 0))
    unseen[once[~_find_close(photographed, rows, once)]] = False
    thing = _Thing(photographed, rows)
    if thing.moves:  # these photos are few of those that show what is around its way
        unseen[:] = explained[:] = False
    hidden = unseen & (tally.beside < HIDDEN_SHARE * tally.uncovered)
    places = [place for place in range(record.look_count) if record.sights[place].silhouette.any()]
    looks = [_open_look(thing, record.sights[place], behind[place], unseen | explained) for place in places]
    sizes = [int(look.silhouette.sum()) for look in looks]
    looks = tuple(looks[place] for place in np.argsort(sizes, kind="stable")[::-1].tolist())
    if not looks:
        return None
    return PhotoEvidence(
        looks,
        unseen=np.flatnonzero(unseen),
        seen=np.flatnonzero(uncovered & reached),
        hidden=np.flatnonzero(hidden),
        explained=np.flatnonzero(explained),
        record=record,
    )


def _fingerprint_photos(document: Document, rows: Int64[ndarray, " k"], left: Int64[ndarray, " m"]) -> bytes:
    """Digest of all that a record depends on: not of what was deleted since."""
    digest = hashlib.blake2b(digest_size=16)
    digest.update(fingerprint(document, (Part.SPLATS, Part.TRANSFORMS, Part.TRACKS, Part.SURROUNDINGS)))
    digest.update(b"%d " % len(rows) + rows.tobytes() + left.tobytes())
    return digest.digest()


def _make_record(photographed: PhotographedSplats, rows: Int64[ndarray, " k"], key: bytes) -> PhotoRecord:
    """Look at the photos that show most of the thing, and at those that show most of what these did not reach."""
    shapes, views = photographed.shapes, photographed.scene.views
    chosen = _choose_views(views, _Thing(photographed, rows))
    sights = [photographed.look(view, camera) for view, camera in _sort_by_time(chosen)]
    tally = _Tally(len(shapes))
    for sight in sights:
        tally.add(sight, sight.behind)
    doubted = (tally.uncovered >= MIN_WEIGHT) & (tally.reaching < MIN_REACHING) & (photographed.scene.nodes == 0)
    witnesses = _choose_witnesses(views, shapes.means[doubted].astype(np.float64), chosen)
    further = [photographed.look(view, camera) for view, camera in _sort_by_time(witnesses)]
    return PhotoRecord(key, (*sights, *further), len(sights))


def _choose_rows(scene: Scene, groups: Sequence[Int64[ndarray, "_"]]) -> Int64[ndarray, " k"]:
    """Splats of the things that stand still; where none does, those of the first thing that moves."""
    filled = [rows for rows in groups if len(rows)]
    still = [rows for rows in filled if np.count_nonzero(scene.nodes[rows]) < len(rows) / 2]
    rows = np.unique(np.concatenate([np.zeros(0, np.int64), *(still or filled[:1])]))
    return rows[scene.nodes[rows] == (0 if still or not len(rows) else np.bincount(scene.nodes[rows]).argmax())]


class _Thing:
    """The solid splats of a thing, where it is at any time."""

    def __init__(self, photographed: PhotographedSplats, rows: Int64[ndarray, " k"]) -> None:
        solid = rows[photographed.opacities[rows] >= OWN_SHARE]
        self._scene, self._node = photographed.scene, int(photographed.scene.nodes[solid[0]])
        self._points = photographed.shapes.means[solid].astype(np.float64)

    @property
    def moves(self) -> bool:
        """Whether it has a track."""
        return self._node > 0

    def find_points(self, time: float, lag: PhotoLag | None) -> Float64[ndarray, "k 3"]:
        """World positions (metres) at a time in seconds; none where it is not there then."""
        if not self._node:
            return self._points
        track = self._scene.actors[self._node - 1]
        if not track.covers(time):
            return np.zeros((0, 3))
        pose = track.interpolate_pose(time, lag)
        return self._points @ pose[:3, :3].T + pose[:3, 3]


def _find_close(
    photographed: PhotographedSplats, rows: Int64[ndarray, " k"], asked: Int64[ndarray, " a"]
) -> Bool[ndarray, " a"]:
    """Which rows lie close to the thing, of which `rows` are the splats."""
    if not len(asked):
        return np.zeros(0, bool)
    solid = photographed.shapes.means[rows[photographed.opacities[rows] >= OWN_SHARE]]
    tree = KDTree(solid, balanced_tree=False, compact_nodes=False)
    distances, _ = tree.query(photographed.shapes.means[asked], distance_upper_bound=CLOSE)
    return np.isfinite(distances)


class _Tally:
    """Sums over sights, a number per splat."""

    def __init__(self, count: int) -> None:
        self.beside = np.zeros(count)
        self.explained = np.zeros(count)
        self.uncovered = np.zeros(count)
        self.reaching = np.zeros(count, np.int64)

    def add(self, sight: PhotoSight, behind: BlendWeights) -> None:
        """Count what a photo shows, and what it would show `behind` the thing."""
        uncovered = np.bincount(behind.rows, behind.weights, len(self.uncovered))
        rows, beside = sight.rows, sight.beside
        self.beside[rows] += beside
        self.explained[rows] += sight.inside
        self.uncovered += uncovered
        self.reaching[rows] += (beside >= REACHED_SHARE * (beside + uncovered[rows])) & (beside >= MIN_WEIGHT / 2)


def _open_look(thing: _Thing, sight: PhotoSight, behind: BlendWeights, lost: Bool[ndarray, " n"]) -> Look:
    """The look with what is open in it once the `lost` splats are gone, too."""
    open_ = np.zeros_like(sight.silhouette)
    covers = apply_weights(behind, np.where(lost, np.float32(0), np.float32(1))[:, None])[:, 0]
    open_[sight.silhouette] = covers < MIN_COVER
    beside_sky = _find_beside_sky(sight.silhouette, sight.sky)
    if thing.moves:
        open_ &= ~beside_sky
    walled = open_ & ~beside_sky & _find_below(sight.silhouette, ~sight.sky)
    place = np.median(thing.find_points(sight.time, sight.camera.lag), axis=0)
    return Look(sight.camera, sight.time, sight.silhouette, open_, sight.nearest, place, walled)


def _find_beside_sky(silhouette: Bool[ndarray, "h w"], sky: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    """Find pixels of the silhouette beside which, left or right of it, the photo shows the sky at the same height."""
    left, right = (_find_below(np.rot90(silhouette, turns), np.rot90(sky, turns)) for turns in (-1, 1))
    return np.rot90(left, 1) | np.rot90(right, -1)


def _find_below(silhouette: Bool[ndarray, "h w"], shown: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    """Find pixels of the silhouette above which, where it ends, the photo shows something."""
    lines = np.broadcast_to(np.arange(len(silhouette))[:, None], silhouette.shape)
    above = np.maximum.accumulate(np.where(silhouette, -1, lines), axis=0)
    return silhouette & np.take_along_axis(np.pad(shown, ((1, 0), (0, 0))), above + 1, 0)


def _sort_by_time(views: Sequence[tuple[CameraView, Camera]]) -> list[tuple[CameraView, Camera]]:
    return sorted(views, key=lambda each: each[0].time)


def _choose_views(views: Sequence[CameraView], thing: _Thing) -> list[tuple[CameraView, Camera]]:
    """Views that show most of the thing, all its parts together, and the cameras of the parts of them that do."""
    found: list[tuple[float, CameraView, Camera, Bool[ndarray, " k"]]] = []
    for view in views:
        points = thing.find_points(view.time, view.camera.lag)
        part = _crop_camera(view.camera, points)
        if part is not None:
            camera, span = part
            found.append((span, view, camera, view.camera.contains(*view.camera.project(points), NEAREST)))
    return choose_covering(found, MAX_LOOKS)


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
