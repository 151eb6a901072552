"""Poses as a synthetic clip's files hold them."""

import numpy as np

from instdrive_core.maths.rotations import matrix_from_quaternion


def pose_matrix(record):
    """The 4×4 matrix of an entry of `poses.json`."""
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(np.array([record["heading"][axis] for axis in "wxyz"]))
    pose[:3, 3] = [record["position"][axis] for axis in "xyz"]
    return pose
