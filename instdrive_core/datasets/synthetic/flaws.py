"""What the flaws of a recording do to poses, exposures and cuboids. Every draw repeats with the seed."""

from __future__ import annotations

import uuid
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from instdrive_core.datasets.synthetic.config import RecordingFlaws
from instdrive_core.datasets.synthetic.world.street import Actor, Street
from instdrive_core.maths.streams import Stream, make_generator

Pose = Float64[ndarray, "4 4"]

_FIRST_LIDAR, _SECOND_LIDAR, _NO_LIDAR = 0, 1, -1
_TWIN_DELAY = (0.012, 0.060)  # seconds between the two LiDARs, as measured in PandaSet
_SLOW, _FAST = (3.0, 6.0), (1.0, 2.0)  # seconds per swing of the exposure


@dataclass(frozen=True)
class Annotation:
    """An object as one annotator followed it."""

    actor: Actor
    uuid: uuid.UUID
    sensor: int = _NO_LIDAR
    """LiDAR in which it was annotated, -1 = does not matter."""
    delay: float = 0.0
    """Seconds from the time step to the moment at which that LiDAR met it."""

    def place_box(self, street: Street, time: float) -> Pose:
        """Compute street_from_box at a time step."""
        return street.box_pose(self.actor, time + self.delay)


def list_annotations(street: Street, flaws: RecordingFlaws, seed: int) -> list[Annotation]:
    """List who is annotated: everybody once, and with twins what moves once more at the end."""
    plain = [Annotation(actor, actor.uuid) for actor in street.actors]
    if not flaws.twin_cuboids:
        return plain
    first = [Annotation(a.actor, a.uuid, _FIRST_LIDAR if a.actor.route.moves else _NO_LIDAR) for a in plain]
    rng = make_generator(seed, Stream.TWIN_CUBOIDS)
    second = [
        Annotation(
            one.actor, uuid.UUID(bytes=rng.bytes(16), version=4), _SECOND_LIDAR, float(rng.uniform(*_TWIN_DELAY))
        )
        for one in first
        if one.sensor == _FIRST_LIDAR
    ]
    return first + second


def shift_box(pose: Pose, error: float, seed: int, number: int, step: int) -> Pose:
    """Shift the box of annotation `number` along the ground: half the error's variance stays, half is new each step."""
    if error == 0:
        return pose
    lasting = make_generator(seed, Stream.CUBOID_ERRORS, number).normal(0, error / 2, 2)
    fresh = make_generator(seed, Stream.CUBOID_ERRORS, number, step).normal(0, error / 2, 2)
    shifted = pose.copy()
    shifted[:3, 3] += pose[:3, :2] @ (lasting + fresh)
    return shifted


def disturb_pose(pose: Pose, flaws: RecordingFlaws, seed: int, sensor: int, step: int) -> Pose:
    """Give a written pose its noise; `sensor` numbers cameras and LiDAR."""
    if not flaws.spoils_poses:
        return pose
    rng = make_generator(seed, Stream.POSE_NOISE, sensor, step)
    turn = Rotation.from_rotvec(np.radians(rng.normal(0, flaws.rotation_noise, 3))).as_matrix()
    noisy = pose.copy()
    noisy[:3, :3] = pose[:3, :3] @ turn
    noisy[:3, 3] += rng.normal(0, flaws.position_noise, 3)
    return noisy


def compute_exposure_factor(flaws: RecordingFlaws, seed: int, camera: int, time: float) -> float:
    """Compute the factor of a camera's exposure at a time: two swings of its own, within the stops asked for."""
    if flaws.exposure_stops == 0:
        return 1.0
    rng = make_generator(seed, Stream.EXPOSURE_DRIFT, camera)
    swings = [np.sin(2 * np.pi * (time / rng.uniform(*period) + rng.uniform())) for period in (_SLOW, _FAST)]
    return float(2 ** (flaws.exposure_stops * np.mean(swings)))
