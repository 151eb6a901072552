"""KITTI's rectified cameras and its LiDAR on the car, whichever of its files say so, and sweeps as it stores them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.posed_photos import build_camera
from instdrive_core.datasets.recording import Lens, Pose, RecordedPhoto, RecordedPoints, RecordedSweep, open_photo_file
from instdrive_core.datasets.rig_files import invert_pose, read_packed_floats
from instdrive_core.errors import DataError

COLOR_CAMERAS = ("image_02", "image_03")
_MOST_DIGITS = 10


@dataclass(frozen=True)
class KittiRig:
    """Where the sensors sit."""

    file: Path
    """The calibration, for messages."""
    imu_from_velodyne: Pose
    rectified_from_velodyne: Pose
    """Rectified axes of camera 0."""
    projections: dict[str, Float64[ndarray, "3 4"]]
    """Pixels from rectified axes, by camera."""

    def place_camera(self, name: str) -> Pose:
        """Place a camera on the IMU: its own centre, the rectified axes."""
        offset = np.eye(4)
        matrix = self.projections[name]
        try:
            offset[:3, 3] = np.linalg.solve(matrix[:, :3], matrix[:, 3])
        except np.linalg.LinAlgError as error:
            raise DataError(self.file, f"the projection of {name} is singular", "Get the file again") from error
        return self.imu_from_velodyne @ invert_pose(offset @ self.rectified_from_velodyne)

    def build_lens(self, name: str, photo: Path) -> Lens:
        """Build the lens of a camera for photos of the size that one of them has."""
        matrix = self.projections[name]
        intrinsics = (float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]))
        return Lens(build_camera(self.file, f"the projection of {name}", intrinsics, read_photo_size(photo)))


def list_counted_files(folder: Path, ending: str) -> dict[int, Path]:
    """List files ``0000000012.png`` by number; empty where there is no such folder."""
    files = (file for file in folder.glob(f"*{ending}") if file.stem.isascii() and file.stem.isdecimal())
    return {int(file.stem): file for file in sorted(files) if len(file.stem) <= _MOST_DIGITS}


def list_photos(
    rig: KittiRig, cameras: dict[str, dict[int, Path]], poses: dict[int, Pose], times: dict[int, float]
) -> tuple[RecordedPhoto, ...]:
    """List the photos of the steps whose pose is known."""
    placed = {name: rig.place_camera(name) for name in cameras}
    return tuple(
        RecordedPhoto(name, step, times[step], poses[step] @ placed[name], file, open_photo_file(file))
        for name, files in cameras.items()
        for step, file in files.items()
        if step in poses
    )


def list_sweeps(
    files: dict[int, Path], poses: dict[int, Pose], imu_from_velodyne: Pose, times: dict[int, float]
) -> tuple[RecordedSweep, ...]:
    """List the sweeps of the steps whose pose is known."""
    placed = {step: poses[step] @ imu_from_velodyne for step in files if step in poses}
    return tuple(
        RecordedSweep(step, times[step], pose, partial(_load_points, files[step], pose))
        for step, pose in placed.items()
    )


def _load_points(file: Path, world_from_velodyne: Pose) -> RecordedPoints:
    rows = read_packed_floats(file, 4)
    points = rows[:, :3].astype(np.float64) @ world_from_velodyne[:3, :3].T + world_from_velodyne[:3, 3]
    return RecordedPoints(points, np.clip(rows[:, 3], 0, 1), np.zeros(len(rows), np.uint8))
