"""A drive as its files say it was recorded: what readers of data sets make, and writers of their layouts take.

Positions are in the file's own world (metres, z up), times in its own seconds; `recorded_clips` makes a clip of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from io import BufferedIOBase
from pathlib import Path

from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from instdrive_core.datasets.distortion import AnyDistortion, Distortion
from instdrive_core.files.plain_file import BoundedReader
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.track import Track

Pose = Float64[ndarray, "4 4"]


@dataclass(frozen=True)
class Lens:
    """A camera of the rig, the same in every photo."""

    camera: Camera
    """At full size; its pose is unset. A fisheye's own intrinsics; clips choose the pinhole that takes its place."""
    distortion: AnyDistortion = field(default_factory=Distortion)
    hidden: float = 0.0
    """Share of the photo's rows, at the bottom, that show the recording car."""


@dataclass(frozen=True)
class RecordedPhoto:
    """A photo and where it was taken."""

    camera: str
    """Name of its lens."""
    step: int
    time: float
    """Seconds when it was exposed."""
    world_from_camera: Pose
    """OpenCV axes."""
    name: Path
    """Its file, or the file that holds it, for messages."""
    open: Callable[[], BufferedIOBase]
    """Opens the encoded photo, e.g. a JPEG's bytes."""

    def read(self) -> bytes:
        """Read the encoded photo."""
        with self.open() as file:
            return file.read()


@dataclass(frozen=True)
class RecordedPoints:
    """Points of a sweep."""

    points: Float64[ndarray, "n 3"]
    """In the world, metres."""
    intensity: Float32[ndarray, " n"]
    """[0, 1]."""
    sensor: UInt8[ndarray, " n"]
    """0 = the spinning LiDAR."""
    times: Float64[ndarray, " n"] | None = None
    """Seconds when each was measured; None where nothing says so."""


@dataclass(frozen=True)
class RecordedSweep:
    """A LiDAR sweep that is read when asked for."""

    step: int
    time: float
    world_from_lidar: Pose
    """Axes of a LiDAR: x forward, y left, z up, or as the data set has them."""
    load: Callable[[], RecordedPoints]


@dataclass(frozen=True)
class Recording:
    """One drive: photos, sweeps and boxes, each with where and when."""

    root: Path
    name: str
    lenses: dict[str, Lens]
    """By camera name: the front one, those beside it, then all others."""
    step_times: dict[int, float]
    """Seconds of each time step; cuboids and photos of a step fit each other."""
    photos: tuple[RecordedPhoto, ...]
    sweeps: tuple[RecordedSweep, ...]
    tracks: tuple[Track, ...]
    """In the world; `moving` is not looked at."""
    world_from_ego: dict[int, Pose] = field(default_factory=dict)
    """Pose of the recording car at each step (x forward, y left, z up); empty where nothing says so."""
    notes: tuple[str, ...] = ()
    """What a user should know before training."""


def open_photo_file(path: Path) -> Callable[[], BufferedIOBase]:
    """Build the function that opens a photo of its own file."""
    return partial(BoundedReader, path)
