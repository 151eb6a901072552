"""Where the recording car and its LiDAR are at a time."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.rig import EGO_HEIGHT, LIDAR_POSITION
from instdrive_core.datasets.synthetic.world.street import Street


def compute_ego_pose(street: Street, time: float) -> Float64[ndarray, "4 4"]:
    """Compute street_from_ego, the pose of the recording car (x right, y forward, z up)."""
    pose = street.ego.pose(time, street.height)
    pose[2, 3] += EGO_HEIGHT
    return pose


def compute_lidar_pose(street: Street, time: float) -> Float64[ndarray, "4 4"]:
    """Compute street_from_lidar, the pose of the LiDAR."""
    mount = np.eye(4)
    mount[:3, 3] = LIDAR_POSITION
    return compute_ego_pose(street, time) @ mount
