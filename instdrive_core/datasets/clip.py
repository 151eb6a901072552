"""Driving clips as the rest of the program sees them, whatever data set they come from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8, UInt32
from numpy import ndarray
from tyro.conf import arg

from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.track import Track

HOLD_OUT_PERIOD, HOLD_OUT_PHASE = 10, 4


def is_held_out(index: int) -> bool:
    """Whether a time step is kept for evaluation (i % 10 == 4); its images, masks and sweeps train nothing."""
    return index % HOLD_OUT_PERIOD == HOLD_OUT_PHASE


@dataclass(frozen=True)
class Frame:
    """One photo. The camera is already at the clip's image scale and relative to the clip's origin."""

    view: CameraView
    load_image: Callable[[], UInt8[ndarray, "h w 3"]]
    """Reads the photo at the clip's image scale, RGB."""
    valid: Bool[ndarray, "h w"] | None = None
    """False on the ego vehicle, and on what moves where nothing is known of its way; None = all valid."""

    @property
    def key(self) -> str:
        """``camera_name/NN``: unique in the clip, and the mask files' relative stem."""
        return f"{self.view.name}/{self.view.index:02d}"


@dataclass(frozen=True)
class SweepPoints:
    """One LiDAR sweep, relative to the clip's origin."""

    points: Float32[ndarray, "n 3"]
    """World coordinates in metres."""
    intensity: Float32[ndarray, " n"]
    """[0, 1]."""
    sensor: UInt8[ndarray, " n"]
    """0 = the spinning LiDAR, 1 = a second, forward one."""
    classes: UInt8[ndarray, " n"] | None
    """Semantic class per point; None where the clip has none."""
    instance_labels: UInt32[ndarray, " n"] | None = None
    """Exact instance per point (synthetic clips only, for evaluation)."""
    times: Float64[ndarray, " n"] | None = None
    """When each point was measured, seconds as the clip counts them; None where the clip does not say."""


@dataclass(frozen=True)
class Sweep:
    """A LiDAR sweep that is read when asked for."""

    index: int
    time: float
    load: Callable[[], SweepPoints]


@dataclass(frozen=True)
class SparsePoints:
    """Coloured points that came with the cameras (structure from motion), relative to the clip's origin."""

    points: Float32[ndarray, "n 3"]
    """World coordinates in the clip's unit."""
    colors: UInt8[ndarray, "n 3"]

    @staticmethod
    def none() -> SparsePoints:
        """No points: training starts from random ones."""
        return SparsePoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))


@dataclass(frozen=True)
class Clip:
    """Cameras, LiDAR, cuboids of one drive. Times are seconds since the first time step listed on disk."""

    path: str
    name: str
    origin: Float64[ndarray, "3"]
    """World position subtracted from everything else (metres)."""
    frames: tuple[Frame, ...]
    """Ordered by (index, camera)."""
    sweeps: tuple[Sweep, ...]
    tracks: tuple[Track, ...]
    """Deduplicated; `moving` is set by path length > 1 m."""
    class_names: dict[int, str]
    """Semantic classes; empty where the clip has none."""
    camera_names: tuple[str, ...]
    points: SparsePoints | None = None
    """Points that training starts from where there is no LiDAR, maybe none at all; None = LiDAR is needed."""
    exact_tracks: tuple[Track, ...] = ()
    """True tracks of a synthetic clip whose cuboids have errors; for evaluation only."""
    notes: tuple[str, ...] = ()
    """Facts that a user should know before training, e.g. that the clip's scale is unknown."""
    world_from_file: Float64[ndarray, "3 4"] | None = None
    """[s R | t] from the world of the photos' own files to the clip's, before `origin` is subtracted; None where they
    are the same."""
    start_poses: Mapping[int, Float64[ndarray, "4 4"]] = field(default_factory=dict)
    """World, before `origin` is subtracted, from that of drivestudio's training that begins at a time step; empty where
    drivestudio does not read such clips."""

    @property
    def training_frames(self) -> tuple[Frame, ...]:
        """Frames that may train."""
        return tuple(frame for frame in self.frames if not frame.view.held_out)

    @property
    def held_out_frames(self) -> tuple[Frame, ...]:
        """Frames of the evaluation split."""
        return tuple(frame for frame in self.frames if frame.view.held_out)

    @property
    def true_tracks(self) -> tuple[Track, ...]:
        """Tracks that results are measured against: the exact ones where the clip has them, else its tracks."""
        return self.exact_tracks or self.tracks

    @property
    def training_sweeps(self) -> tuple[Sweep, ...]:
        """Sweeps that may train."""
        return tuple(sweep for sweep in self.sweeps if not is_held_out(sweep.index))

    def with_cameras(self, views: Sequence[CameraView]) -> Clip:
        """Copy the clip with the poses and lags of these views, e.g. those that training used; the others stay."""
        cameras = {(view.name, view.index): view.camera for view in views}
        return replace(self, frames=tuple(_place_frame(frame, cameras) for frame in self.frames))


def _place_frame(frame: Frame, cameras: Mapping[tuple[str, int], Camera]) -> Frame:
    view = frame.view
    other = cameras.get((view.name, view.index), view.camera)
    camera = replace(view.camera, world_from_camera=other.world_from_camera, lag=other.lag)
    return replace(frame, view=replace(view, camera=camera))


@dataclass(frozen=True)
class ClipOptions:
    """Part of a clip to load, and its image size."""

    cameras: str = "6"
    """Camera set: 1 (front), 3 (front and front sides), 6 (all), or names joined by commas; where cameras have no known
    place: the first, the first three, all."""
    scale: float | None = None
    """Image scale relative to the photos on disk, up to 1; default: makes them 480 pixels wide (PandaSet: 0.25)."""
    first_frame: Annotated[int | str | None, arg(name="first", aliases=["--first-frame"])] = None
    """First time step to use, e.g. 30, or seconds since the log's first, e.g. 3s; default: the log's first."""
    last_frame: Annotated[int | str | None, arg(name="last", aliases=["--last-frame"])] = None
    """Last time step or second to use, inclusive, e.g. 59 or 8.5s; default: the log's last."""
    fisheye_field: float = 100.0
    """Degrees across the photos of fisheye cameras that are kept; they are read as pinhole photos. Up to 160."""


def choose_origin(points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "3"]:
    """Choose a clip's origin: the mean position, rounded to whole metres so that it prints well."""
    return np.round(points.mean(axis=0))
