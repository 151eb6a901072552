"""Sweeps that requests ask for: one turn of the server's LiDAR wherever a request places it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.recording.lidar import Lidar, cast_pattern
from instdrive_core.scene.scene import Scene
from instdrive_core.serving.messages import find_message_class, name_enum_value
from instdrive_core.serving.requests import FrameSpan, Limits, PosePair, Rate, RequestError, read_frame, read_pose_pair
from instdrive_core.serving.stage import Stage
from instdrive_core.sweeps.cast import RayCaster
from instdrive_core.sweeps.pattern import AMID, Pattern
from instdrive_core.sweeps.rig import Rig

AS_ASKED = "PANDAR128"
"""The sensor that a server casts where it was not told another: the one that requests name by themselves."""


@dataclass(frozen=True)
class ServedLidar:
    """A LiDAR, and what it needs of the scene, computed once."""

    lidar: Lidar
    chosen: bool
    """Whether the server was told which sensor it is: then it is cast whatever a request names."""
    casters: dict[tuple[float, float], RayCaster] = field(default_factory=dict)

    def cast(self, stage: Stage, request: Any, last: float, limits: Limits, rate: Rate) -> Any:
        """Cast the sweep that a LidarRenderRequest asks for.

        Args:
            stage: the drive.
            request: its scene has been checked.
            last: end of the drive, seconds.
            limits: of counts.
            rate: from which the rays are taken.

        Raises RequestError naming the field that is wrong, TooFastError where the rate has no such many rays left.
        """
        frame = read_frame(request, last)
        asked = name_enum_value("LidarDeviceType", request.lidar_config.lidar_type)
        if asked != AS_ASKED and not self.chosen:
            remedy = f"send {AS_ASKED}, or start the server with --lidar and a file that describes the sensor"
            raise RequestError("lidar_config.lidar_type", asked, remedy)
        pair = read_pose_pair("sensor_pose", request.sensor_pose)
        scene = stage.place(request.dynamic_objects, frame, limits)
        pattern = self.lidar.find_pattern(frame.middle)
        rate.take(len(pattern.delays))
        caster = self._find_caster(stage.scene, pattern).with_posed(scene)
        rig, turn = _carry(pair, frame), _time_within(pattern, frame)
        number = request.frame_start_us & 0xFFFFFFFF
        sweep = cast_pattern(caster, turn, rig, frame.middle, self.lidar.intensities, number, self.lidar.drop)
        return _write_sweep((sweep.points - pair.end[:3, 3]) @ pair.end[:3, :3], sweep.intensity)

    def _find_caster(self, scene: Scene, pattern: Pattern) -> RayCaster:
        key = (pattern.near, pattern.far)
        if key not in self.casters:
            self.casters.clear()
            self.casters[key] = RayCaster(scene, *key, offsets=self.lidar.offsets)
        return self.casters[key]


def _carry(pair: PosePair, frame: FrameSpan) -> Rig:
    """The rig that carries the sensor through its frame."""
    if frame.end > frame.start:
        return Rig(np.array([frame.start, frame.end]), np.stack([pair.start, pair.end]))
    return Rig(np.array([frame.start]), pair.middle[None])


def _time_within(pattern: Pattern, frame: FrameSpan) -> Pattern:
    """A sweep that takes its frame's time, around the sensor itself."""
    delays = pattern.delays.astype(np.float64)
    span = float(np.ptp(delays)) if len(delays) else 0.0
    shares = (delays - delays.min(initial=0.0)) / span - 0.5 if span > 0 else np.zeros(len(delays))
    return replace(pattern, delays=(shares * (frame.end - frame.start)).astype(np.float32), place=AMID)


def _write_sweep(points: ndarray, intensity: Float32[ndarray, " n"]) -> Any:
    """Points as the message has them: as lists of numbers, and as bytes of little-endian float32."""
    places, strengths = np.ascontiguousarray(points, "<f4"), np.clip(intensity, 0, 1).astype("<f4")
    return find_message_class("LidarRenderReturn")(
        point_xyzs=places.reshape(-1).tolist(),
        point_intensities=strengths.tolist(),
        num_points=len(places),
        point_xyzs_buffer=places.tobytes(),
        point_intensities_buffer=strengths.tobytes(),
    )
