"""Files in PandaSet's layout, as the originals have them: same names, columns, types and number formats."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.datasets.pickled_tables import build_object_column, write_table
from instdrive_core.datasets.synthetic.flaws import Annotation
from instdrive_core.datasets.synthetic.sensors.lidar import LidarSweep
from instdrive_core.datasets.synthetic.world.street import CLASSES, Actor

Pose = Float64[ndarray, "4 4"]


def write_json(path: Path, content: object) -> None:
    """Write JSON on one line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_sweep(folder: Path, step: int, sweep: LidarSweep, world_from_street: Pose, time: float) -> None:
    """Write ``lidar/NN.pkl.gz`` and ``annotations/semseg/NN.pkl.gz``."""
    points = sweep.points @ world_from_street[:3, :3].T + world_from_street[:3, 3]
    count = len(points)
    columns = {
        "x": points[:, 0].copy(),
        "y": points[:, 1].copy(),
        "z": points[:, 2].copy(),
        "i": sweep.intensities,
        "t": np.full(count, time),
        "d": np.zeros(count, np.int64),
    }
    write_table(folder / "lidar" / f"{step:02d}.pkl.gz", columns, "index")
    semseg = folder / "annotations" / "semseg" / f"{step:02d}.pkl.gz"
    write_table(semseg, {"class": sweep.classes.astype(np.int64)})


def write_classes(folder: Path) -> None:
    """Write ``annotations/semseg/classes.json``."""
    names = {str(k + 1): name for k, name in enumerate(CLASSES)}
    path = folder / "annotations" / "semseg" / "classes.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(names, indent=2))


def write_cuboids(file: Path, annotations: Sequence[Annotation], world_from_box: Float64[ndarray, "n 4 4"]) -> None:
    """Write a time step's cuboids, one row per annotation."""
    poses = world_from_box
    actors = [annotation.actor for annotation in annotations]
    dimensions = np.stack([actor.dimensions for actor in actors])
    columns: dict[str, ndarray] = {
        "uuid": build_object_column([str(annotation.uuid) for annotation in annotations]),
        "label": build_object_column([actor.label for actor in actors]),
        "yaw": np.arctan2(poses[:, 1, 0], poses[:, 0, 0]),
        "stationary": np.array([not actor.route.moves for actor in actors]),
        "camera_used": np.full(len(actors), -1, np.int64),
    }
    columns |= {f"position.{axis}": poses[:, k, 3].copy() for k, axis in enumerate("xyz")}
    columns |= {f"dimensions.{axis}": dimensions[:, k].copy() for k, axis in enumerate("xyz")}
    columns |= _build_attributes(actors, np.array([annotation.sensor for annotation in annotations], np.int64))
    write_table(file, columns)


def _build_attributes(actors: Sequence[Actor], sensors: Int64[ndarray, " n"]) -> dict[str, ndarray]:
    """The columns behind the boxes, in PandaSet's order; NaN where an attribute does not apply."""
    people = [actor.behavior is not None for actor in actors]
    return {
        "attributes.object_motion": build_object_column([actor.motion or np.nan for actor in actors]),
        "cuboids.sibling_id": build_object_column(["-"] * len(actors)),
        "cuboids.sensor_id": sensors,
        "attributes.rider_status": build_object_column([actor.rider or np.nan for actor in actors]),
        "attributes.pedestrian_behavior": build_object_column([actor.behavior or np.nan for actor in actors]),
        "attributes.pedestrian_age": build_object_column(["Adult" if person else np.nan for person in people]),
    }
