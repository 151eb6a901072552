"""What a request may ask for, and how its numbers are read: everything from the wire is checked here."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import InstDriveError
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from instdrive_core.serving.messages import find_message_class

FARTHEST = 1e6
"""Metres from the scene's origin, at most."""
LONGEST_FRAME = 1.0
"""Seconds from a frame's start to its end, at most."""
LONGEST_AFTER = 600.0
"""Seconds after the drive's end that may be asked for: later times are those of another clock."""
_SHOWN = 60
"""Characters of a value that errors repeat."""


@dataclass(frozen=True)
class Limits:
    """What one client may cost."""

    pixels: int = 16_000_000
    """All pictures of a request together may have."""
    lens_pixels: int = 4_000_000
    """That a picture may have whose lens is no pinhole: it takes many times the memory."""
    pictures: int = 64
    """That a request may ask for, and sweeps."""
    side: int = 8192
    """Width or height of a picture, pixels."""
    requests: int = 8
    """In flight; more are refused at once."""
    message_bytes: int = 1 << 20
    """Size of a request."""
    objects: int = 1000
    """Things that a request may place."""
    rate: int = 64_000_000
    """Pixels and rays a second that all requests together may ask for."""


USUAL_LIMITS = Limits()


class RequestError(InstDriveError):
    """A request cannot be answered.

    Args:
        field: which one is wrong, as the message names it.
        value: what it holds.
        remedy: what to send instead.
    """

    def __init__(self, field: str, value: Any, remedy: str) -> None:
        shown = str(value)
        shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "…"
        super().__init__(f"{field} is {shown}; {remedy}")
        self.field, self.remedy = field, remedy


class TooFastError(InstDriveError):
    """Requests ask for more than the server answers in that time; the message says when to ask again."""


class Rate:
    """Lets so many pixels and rays a second pass; after a rest, as many at once as a second or one request has.

    Args:
        limits: `rate` a second, and `pixels` of one request.
        read_clock: seconds that only rise.
    """

    def __init__(self, limits: Limits, read_clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._most, self._read = limits.rate, max(limits.rate, limits.pixels), read_clock
        self._left, self._read_at, self._lock = float(self._most), read_clock(), threading.Lock()

    def take(self, count: int) -> None:
        """Take pixels or rays of one request. Raises TooFastError, and takes none, where too few are left."""
        with self._lock:
            now = self._read()
            self._left = min(self._left + (now - self._read_at) * self._rate, self._most)
            self._read_at = now
            missing = min(count, self._most) - self._left
            if missing > 0:
                wait = f"ask again in {missing / self._rate:.1f} s"
                raise TooFastError(f"the server answers {self._rate:,} pixels and rays a second; {wait}")
            self._left -= count


@dataclass(frozen=True)
class FrameSpan:
    """From when to when a sensor looks, seconds of the drive."""

    start: float
    end: float

    @property
    def middle(self) -> float:
        """Amid the two."""
        return (self.start + self.end) / 2


@dataclass(frozen=True)
class PosePair:
    """A pose at the start and the end of a frame, in the world."""

    start: Float64[ndarray, "4 4"]
    end: Float64[ndarray, "4 4"]

    @property
    def middle(self) -> Float64[ndarray, "4 4"]:
        """Half-way between the two."""
        quats = quaternion_from_matrix(np.stack([self.start[:3, :3], self.end[:3, :3]]))
        pose = np.eye(4)
        pose[:3, :3] = matrix_from_quaternion(slerp(quats[0], quats[1], 0.5))
        pose[:3, 3] = (self.start[:3, 3] + self.end[:3, 3]) / 2
        return pose


def read_frame(request: Any, last: float) -> FrameSpan:
    """Read when a request's frame is.

    Args:
        request: with `frame_start_us` and `frame_end_us`.
        last: end of the drive, seconds.
    """
    start, end = request.frame_start_us / 1e6, request.frame_end_us / 1e6
    if start > last + LONGEST_AFTER:
        clock = f"count microseconds from the drive's first time step, to its end at {last * 1e6:.0f}"
        raise RequestError("frame_start_us", request.frame_start_us, clock)
    if not start <= end <= start + LONGEST_FRAME:
        remedy = f"send frame_start_us = {request.frame_start_us} or up to {LONGEST_FRAME:g} s more"
        raise RequestError("frame_end_us", request.frame_end_us, remedy)
    return FrameSpan(start, end)


def read_pose_pair(field: str, message: Any) -> PosePair:
    """Read a pose at a frame's start and end. Raises RequestError naming the part of `field` that is wrong."""
    poses = []
    for part in ("start_pose", "end_pose"):
        if not message.HasField(part):
            raise RequestError(f"{field}.{part}", "missing", "send both poses, equal ones where nothing moves")
        poses.append(_read_pose(f"{field}.{part}", getattr(message, part)))
    return PosePair(*poses)


def write_pose(pose: Float64[ndarray, "4 4"]) -> Any:
    """Write a pose as a message."""
    found = find_message_class("Pose")()
    found.vec.x, found.vec.y, found.vec.z = pose[:3, 3].tolist()
    quat = quaternion_from_matrix(pose[:3, :3]).tolist()
    found.quat.w, found.quat.x, found.quat.y, found.quat.z = quat
    return found


def require_between(field: str, value: float, low: float, high: float) -> float:
    """Return a finite number within bounds. Raises RequestError else."""
    if not (math.isfinite(value) and low <= value <= high):
        raise RequestError(field, f"{value:g}", f"send a number from {low:g} to {high:g}")
    return value


def require_pixels(pixels: int, limits: Limits) -> None:
    """Raise RequestError where the pictures of a request have more pixels together than it may ask for."""
    if pixels > limits.pixels:
        remedy = f"a request may ask for {limits.pixels:,} pixels; ask for fewer or smaller pictures"
        raise RequestError("resolution_w × resolution_h", f"{pixels:,} pixels", remedy)


def _read_pose(field: str, message: Any) -> Float64[ndarray, "4 4"]:
    pose = np.eye(4)
    for axis, name in enumerate("xyz"):
        pose[axis, 3] = require_between(f"{field}.vec.{name}", getattr(message.vec, name), -FARTHEST, FARTHEST)
    quat = np.array([message.quat.w, message.quat.x, message.quat.y, message.quat.z])
    length = float(np.linalg.norm(quat))
    if not 0.99 <= length <= 1.01:
        shown = "(" + ", ".join(f"{part:g}" for part in quat.tolist()) + ")"
        raise RequestError(f"{field}.quat", shown, "send w, x, y, z with a length of 1")
    pose[:3, :3] = matrix_from_quaternion(quat)
    return pose
