"""The recording car: where its six cameras and its LiDAR sit.

Camera poses and intrinsics are those of PandaSet sequence 002 (CC BY 4.0, Hesai and Scale AI), taken from time step 0,
where the car stands still: camera pose relative to `lidar/poses.json`, which is a frame at the car with x right,
y forward, z up. Its LiDAR sees the road 0.37 m below that frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.synthetic.config import HDL32, HDL64, VLP16
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera

REFERENCE_WIDTH, REFERENCE_HEIGHT = 1920, 1080
EGO_HEIGHT = 0.37
"""Height of the car's frame over the road in metres."""
LIDAR_POSITION = np.array([0.0, 0.35, 1.88])
"""The LiDAR in the car's frame: on the roof, just above and behind the front camera."""
LIDAR_RANGE = 120.0
LIDAR_BLIND_RANGE = 1.2


@dataclass(frozen=True)
class RigCamera:
    """One camera of the rig, calibrated for 1920×1080 photos."""

    name: str
    position: tuple[float, float, float]
    """Place in the car's frame (metres)."""
    heading: tuple[float, float, float, float]
    """Quaternion wxyz from OpenCV camera axes to the car's frame."""
    fx: float
    fy: float
    cx: float
    cy: float

    def place(self, world_from_ego: Float64[ndarray, "4 4"], width: int, height: int) -> Camera:
        """The camera on a car at `world_from_ego`, on a raster of `width`×`height` pixels."""
        ego_from_camera = np.eye(4)
        ego_from_camera[:3, :3] = matrix_from_quaternion(np.array(self.heading))
        ego_from_camera[:3, 3] = self.position
        full = Camera(
            self.fx, self.fy, self.cx, self.cy, REFERENCE_WIDTH, REFERENCE_HEIGHT, world_from_ego @ ego_from_camera
        )
        return full.resize(width, height)


# fmt: off
CAMERAS = (
    RigCamera(
        "front_camera", (0.0008, 0.8472, 1.8071), (0.708236, -0.70591, -0.008197, -0.005123),
        1970.0131, 1970.0091, 970.0002, 483.2988,
    ),
    RigCamera(
        "front_left_camera", (-0.6444, 1.5091, 1.5314), (0.62015, -0.618231, -0.340382, 0.342554),
        929.8429, 930.0592, 972.1794, 508.0057,
    ),
    RigCamera(
        "front_right_camera", (0.6018, 1.4838, 1.6028), (0.625374, -0.612621, 0.342241, -0.341284),
        930.0407, 930.0324, 965.0525, 463.4161,
    ),
    RigCamera(
        "left_camera", (-0.5348, 0.5429, 1.5773), (0.499145, -0.487155, -0.504409, 0.509025),
        930.4514, 930.0891, 991.6883, 541.6057,
    ),
    RigCamera(
        "right_camera", (0.6955, 0.5905, 1.5521), (0.510575, -0.501587, 0.490698, -0.49693),
        922.5465, 922.4229, 945.057, 517.575,
    ),
    RigCamera(
        "back_camera", (0.0332, -0.2637, 1.6498), (0.011975, -0.009415, 0.705869, -0.708179),
        933.4667, 934.6754, 896.4692, 507.3557,
    ),
)
# fmt: on


def compute_beam_elevations(lidar: str) -> Float64[ndarray, " beams"]:
    """Elevations of the beams of one of `LIDARS`, in radians, from its data sheet.

    Pandar64: 1/6° apart near the horizon; HDL-64E: two blocks, 1/3° and 1/2° apart; HDL-32E: 4/3°; VLP-16: 2°.
    """
    if lidar == HDL64:
        degrees = np.r_[np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)]
    elif lidar == HDL32:
        degrees = np.linspace(10.67, -30.67, 32)
    elif lidar == VLP16:
        degrees = np.linspace(15.0, -15.0, 16)
    else:
        lower = (-7.0, -8.0, -9.0, -10.0, -11.0, -12.0, -13.0, -14.0, -19.0, -25.0)
        degrees = np.r_[15.0, 11.0, 8.0, 5.0, 3.0, 2.0 - np.arange(49) / 6, lower]
    return np.radians(degrees)


def compute_lidar_directions(lidar: str, azimuths: int) -> Float32[ndarray, "n 3"]:
    """Unit directions of one turn of one of `LIDARS` in its frame (x right, y forward, z up): beam by beam within each
    azimuth, clockwise from behind."""
    azimuth = -np.pi + 2 * np.pi * (np.arange(azimuths) + 0.5) / azimuths
    elevation = compute_beam_elevations(lidar)
    horizontal = np.cos(elevation)
    directions = np.empty((azimuths, len(elevation), 3))
    directions[..., 0] = np.sin(azimuth)[:, None] * horizontal
    directions[..., 1] = np.cos(azimuth)[:, None] * horizontal
    directions[..., 2] = np.sin(elevation)
    return directions.reshape(-1, 3).astype(np.float32)
