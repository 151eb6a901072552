"""Phantom cars: boxes on free ground of a real drive whose silhouettes no training photo or sweep is shown.

What the boxes hide is then as unseen as what is behind a parked car, and the photos themselves are the truth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull, KDTree

from benchmarks.hole_streets import spread_views
from benchmarks.uncovered import LEAST, Uncovered
from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints
from instdrive_core.errors import DataError
from instdrive_core.instances.table import Instance, InstanceTable
from instdrive_core.masks.annotated.truth import AnnotatedTruth
from instdrive_core.masks.image.beams import estimate_sensor_position
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene

SIZE = np.array([4.5, 1.9, 1.5])
"""Length, width and height of a phantom car, metres."""
GROUND = ("Road", "Sidewalk", "Ground", "Driveway", "Lane Line Marking", "Stop Line Marking", "Other Road Marking")
CLEARANCE = 0.3
"""Metres around a phantom, and above the ground beneath it, that no sweep may have touched."""
NEAREST, FARTHEST = 3.5, 14.0
"""Metres along the ground from a phantom's middle to the nearest camera of all."""
APART = 8.0
"""Metres between phantoms."""
LEAST_POINTS = 60
"""LiDAR points of ground beneath a phantom that say how high it stands."""
REACH = 3.0
"""Metres around its middle that a phantom and its clearance fit into."""
MOST_TRIES = 5000
"""Places that are tried."""
NEAR = 0.3
"""Metres before a camera: what is nearer is not drawn."""
STEP = 0.1
"""Metres between the points of a phantom's surface."""


@dataclass(frozen=True)
class Phantom:
    """An upright box."""

    center: Float64[ndarray, "3"]
    """Metres, relative to the clip's origin."""
    axes: Float64[ndarray, "3 3"]
    """Rows: along, across, up."""

    def locate(self, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
        """Coordinates along the axes, in halves of the box's sides: inside they lie from -1 to 1."""
        return (points - self.center) @ self.axes.T / (SIZE / 2)

    def list_surface(self) -> Float64[ndarray, "n 3"]:
        """Points of the surface."""
        steps = [np.linspace(-1, 1, round(side / STEP) + 1) for side in SIZE]
        grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        return self.center + grid[np.abs(grid).max(axis=1) == 1] * (SIZE / 2) @ self.axes

    def draw(self, camera: Camera) -> Bool[ndarray, "h w"]:
        """The pixels that show it, with a pixel around them."""
        pixels, depths = camera.project(self.list_surface())
        size = np.array([camera.width, camera.height])
        pixels, inside = np.clip(pixels[depths > NEAR], -size, 2 * size), Image.new("L", (camera.width, camera.height))
        if len(pixels) > 3 and np.ptp(pixels, axis=0).min() >= 1:
            outline = pixels[ConvexHull(pixels, qhull_options="QJ").vertices]
            ImageDraw.Draw(inside).polygon([(float(x) - 0.5, float(y) - 0.5) for x, y in outline], fill=1, outline=1)
        return np.asarray(inside, bool)

    def find_hidden(self, eye: Float64[ndarray, "3"], points: Float64[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
        """Which points lie in it or behind it as seen from `eye` (slabs of Kay & Kajiya, 1986)."""
        start, end = self.locate(eye[None])[0], self.locate(points)
        ways = end - start
        ways = np.where(np.abs(ways) < 1e-9, 1e-9, ways)
        ends = np.stack([(-1 - start) / ways, (1 - start) / ways])
        enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        return (enter <= leave) & (leave > 0) & (enter < 1)


def place_phantoms(clip: Clip, count: int, rng: np.random.Generator) -> list[Phantom]:
    """Place up to `count` boxes beside the way of the cameras where ground lies free in all sweeps.

    Raises DataError where the clip names no ground or has no free place.
    """
    numbers = [number for number, name in clip.class_names.items() if name in GROUND]
    sweeps = [sweep.load() for sweep in clip.sweeps]
    if not numbers or any(sweep.classes is None for sweep in sweeps):
        raise DataError(clip.path, "has no LiDAR points named as ground", "Phantom cars need a clip with labels")
    points = np.concatenate([sweep.points for sweep in sweeps]).astype(np.float64)
    flat = np.isin(np.concatenate([sweep.classes for sweep in sweeps if sweep.classes is not None]), numbers)
    cameras = [frame.view.camera for frame in clip.frames if frame.view.name == clip.camera_names[0]]
    eyes = np.array([camera.position for camera in cameras])
    gaps, nearest = KDTree(eyes[:, :2]).query(points[:, :2])
    close = np.flatnonzero(gaps <= FARTHEST + REACH)
    around = KDTree(points[close, :2])
    wanted = np.flatnonzero(flat & (gaps >= NEAREST) & (gaps <= FARTHEST))
    placed: list[Phantom] = []
    for row in rng.permutation(wanted)[:MOST_TRIES].tolist():
        place = points[row]
        if any(np.linalg.norm(place[:2] - other.center[:2]) < APART for other in placed):
            continue
        rows = close[around.query_ball_point(place[:2], REACH)]
        phantom = _stand(place, cameras[int(np.asarray(nearest)[row])], points[rows], flat[rows])
        if phantom is not None:
            placed.append(phantom)
        if len(placed) == count:
            return placed
    if not placed:
        raise DataError(clip.path, "has no free ground beside the road", "Take another clip or another part of it")
    return placed


def _stand(
    place: Float64[ndarray, "3"], camera: Camera, points: Float64[ndarray, "n 3"], flat: Bool[ndarray, " n"]
) -> Phantom | None:
    """A box on the ground at a place, along the camera's way; None where it is not free."""
    along = camera.world_from_camera[:3, 2] * [1, 1, 0]
    along /= np.linalg.norm(along)
    axes = np.array([along, np.cross([0, 0, 1.0], along), [0, 0, 1.0]])
    near = np.abs((points - place) @ axes.T) <= SIZE / 2 + CLEARANCE + [0, 0, 1.0]
    near = near.all(axis=1)
    beneath = points[near & flat]
    if len(beneath) < LEAST_POINTS or np.ptp(np.quantile(beneath[:, 2], [0.05, 0.95])) > CLEARANCE:
        return None
    floor = float(np.median(beneath[:, 2]))
    heights = points[near, 2] - floor
    if ((heights > CLEARANCE) & (heights < SIZE[2] + CLEARANCE)).any():
        return None
    return Phantom(np.array([place[0], place[1], floor + SIZE[2] / 2]), axes)


def hide_phantoms(clip: Clip, phantoms: Sequence[Phantom]) -> Clip:
    """The clip as if nothing could be seen where the boxes are, and behind them."""

    def hide_sweep(sweep: Sweep) -> Sweep:
        eye = estimate_sensor_position(clip, sweep.time)
        return replace(sweep, load=lambda: _hide_points(sweep.load(), eye, phantoms))

    return replace(
        clip,
        frames=tuple(_hide_pixels(frame, phantoms) for frame in clip.frames),
        sweeps=tuple(hide_sweep(sweep) for sweep in clip.sweeps),
    )


def _hide_pixels(frame: Frame, phantoms: Sequence[Phantom]) -> Frame:
    camera = frame.view.camera
    valid = np.ones((camera.height, camera.width), bool) if frame.valid is None else frame.valid.copy()
    for phantom in phantoms:
        valid &= ~phantom.draw(camera)
    return replace(frame, valid=valid)


def _hide_points(sweep: SweepPoints, eye: Float64[ndarray, "3"], phantoms: Sequence[Phantom]) -> SweepPoints:
    kept = np.ones(len(sweep.points), bool)
    for phantom in phantoms:
        kept &= ~phantom.find_hidden(eye, sweep.points.astype(np.float64))
    columns = {
        name: None if column is None else column[kept]
        for name, column in (
            ("points", sweep.points), ("intensity", sweep.intensity), ("sensor", sweep.sensor),
            ("classes", sweep.classes), ("instance_labels", sweep.instance_labels), ("times", sweep.times),
        )
    }  # fmt: skip
    return replace(sweep, **columns)


def add_phantom(scene: Scene, phantom: Phantom) -> tuple[Scene, int]:
    """A copy of a scene with the box in it as a new instance, and its ID."""
    number = max((instance.id for instance in scene.table), default=0) + 1
    places = phantom.list_surface().astype(np.float32)
    count, like = len(places), scene.gaussians
    box = Gaussians(
        places,
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full((count, 3), np.log(STEP), np.float32),
        logit(np.full(count, 0.99, np.float32)),
        dc_from_color(np.full((count, 3), 0.5, np.float32)).astype(np.float32),
        np.zeros((count, like.sh_rest.shape[1], 3), np.float32),
        np.zeros((count, like.features.shape[1]), np.float32),
    )
    lower, upper = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    table = InstanceTable(dict(scene.table.instances))
    bounds = ((lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2]))
    table.set(Instance(number, "Phantom", count=count, class_name="Car", bounds=bounds))
    added = replace(
        scene,
        gaussians=concatenate_gaussians([box, like]),
        instance_ids=np.concatenate([np.full(count, number, np.uint32), scene.instance_ids]),
        codewords=np.concatenate([np.zeros(count, np.uint32), scene.codewords]),
        nodes=np.concatenate([np.zeros(count, np.uint16), scene.nodes]),
        extra={name: np.concatenate([np.zeros(count, old.dtype), old]) for name, old in scene.extra.items()},
        table=table,
    )
    return added, number


def list_phantom_photos(clip: Clip, truth: AnnotatedTruth, phantom: Phantom, count: int) -> Iterator[Uncovered]:
    """The real photos that show most of the place where a box is."""
    frames = {(frame.view.name, frame.view.index): frame for frame in clip.frames}
    views = [frame.view for frame in clip.frames]
    areas = np.array([np.count_nonzero(phantom.draw(view.camera)) for view in views])
    for view in spread_views(views, areas, count):
        frame = frames[view.name, view.index]
        hidden = phantom.draw(view.camera) & (True if frame.valid is None else frame.valid)
        parts = {"ground": hidden & _find_kind(truth, frame, GROUND), "wall": hidden & _find_stuff(truth, frame)}
        if any(inside.sum() >= LEAST for inside in parts.values()):
            yield Uncovered(view, _load_photo(frame), parts)


def _load_photo(frame: Frame) -> Float32[ndarray, "h w 3"]:
    return frame.load_image().astype(np.float32) / 255


def _find_kind(truth: AnnotatedTruth, frame: Frame, names: Sequence[str]) -> Bool[ndarray, "h w"]:
    chosen = [number for number, fact in truth.labels.instances.items() if fact.class_name in names]
    return np.isin(truth.labels.load_parts(frame)[0], chosen)


def _find_stuff(truth: AnnotatedTruth, frame: Frame) -> Bool[ndarray, "h w"]:
    facts = truth.labels.instances.values()
    return _find_kind(
        truth,
        frame,
        [fact.class_name for fact in facts if fact.kind == "stuff" and fact.class_name not in (*GROUND, "Vegetation")],
    )
