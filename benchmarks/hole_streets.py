"""Parked cars of synthetic streets, and the streets ray-traced without them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int32, Int64, Integer, UInt8
from numpy import ndarray

from benchmarks.uncovered import LEAST, Uncovered
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.sensors.render import StepRenderer
from instdrive_core.datasets.synthetic.world.light import Light
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.instances.table import Instance
from instdrive_core.masks.label_map_folder import SIDECAR
from instdrive_core.masks.making import make_masks
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.training.run import FACTS, RunRequest, run_training
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import Preset, build_train_config

GROUND = ("Road", "Sidewalk", "Ground")
NO_WALL = (*GROUND, "Vegetation")
LEAST_LIT = 0.04
"""Change of brightness from which ground beside a car counts as its shadow."""
NEAREST = 1.2
"""Metres between an instance's middle and the car of the street that it is taken for."""


def train_street(config: StreetConfig, folder: Path, preset: Preset) -> Path:
    """Record a street, make exact masks and train it, unless the folder holds the run already; returns the run."""
    clip, masks, run = folder / "street", folder / "masks", folder / "run"
    if (run / FACTS).is_file():
        return run
    if not (masks / SIDECAR).is_file():
        write_street(clip, config)
        make_masks(load_clip(str(clip), ClipOptions(scale=1.0)), "exact", masks, config.seed)
    request = RunRequest(
        clip, run, ClipOptions(scale=1.0), build_train_config("instdrive", preset, 0), masks, sizes=AskedSizes()
    )
    return run_training(replace(request, resume=run.is_dir()), lambda event: None, lambda note: None)


def list_uncovered(scene: Scene, street: Street, car: int, views: Sequence[CameraView]) -> Iterator[Uncovered]:
    """The truth behind actor number `car` of the street; photos that show none of it are left out."""
    inverse = np.linalg.inv(street.world_from_street())
    without = replace(street, actors=tuple(actor for number, actor in enumerate(street.actors) if number != car))
    classes = np.array(["", *(fixture.label for fixture in street.fixtures)])
    for view in views:
        pose = view.camera.world_from_camera.copy()
        pose[:3, 3] += scene.origin
        camera = replace(view.camera, world_from_camera=inverse @ pose)
        full, free = (photograph(each, camera, view.time, street.light) for each in (street, without))
        hidden = full[1] == street.actor_id(car)
        behind = classes[np.where(free[1] < len(classes), free[1], 0)]
        ground = np.isin(behind, GROUND)
        wall = hidden & (behind != "") & ~np.isin(behind, NO_WALL)
        darker = (free[0].mean(axis=2) - full[0].mean(axis=2)) / 255 >= LEAST_LIT
        parts = {"ground": hidden & ground, "wall": wall, "shadow": ~hidden & ground & darker & (full[1] == free[1])}
        if any(inside.sum() >= LEAST for inside in parts.values()):
            yield Uncovered(view, free[0].astype(np.float32) / 255, parts)


def photograph(
    street: Street, camera: Camera, time: float, light: Light
) -> tuple[UInt8[ndarray, "h w 3"], Int32[ndarray, "h w"]]:
    photo = StepRenderer(street.geometry(time), street.materials, light).photograph(camera)
    return photo.image, photo.labels.astype(np.int32)


def find_parked_car(scene: Scene, street: Street, instance: Instance) -> int | None:
    """The street's actor that an instance is; None where none stands there."""
    middle = np.mean(instance.bounds, axis=0) + scene.origin
    distances = {
        number: float(np.linalg.norm(((street.world_from_street() @ street.box_pose(actor, 0))[:3, 3] - middle)[:2]))
        for number, actor in enumerate(street.actors)
        if not actor.route.moves and actor.label == "Car"
    }
    nearest = min(distances, key=lambda number: distances[number], default=None)
    return nearest if nearest is not None and distances[nearest] < NEAREST else None


def count_instance_pixels(scene: Scene) -> Int64[ndarray, "views ids"]:
    """Pixels of each ID in each of the scene's photos."""
    size, counts = max((instance.id for instance in scene.table), default=0) + 1, []
    for view in scene.views:
        ids = build_instance_map(scene, view_scene(scene, view.camera, view.time))
        counts.append(np.bincount(ids.ravel(), minlength=size))
    return np.array(counts, np.int64).reshape(len(scene.views), size)


def spread_views(views: Sequence[CameraView], areas: Integer[ndarray, " n"], count: int) -> list[CameraView]:
    """The views with the largest areas above 0, no two of one camera within four time steps."""
    chosen: list[CameraView] = []
    for index in np.argsort(-areas, kind="stable").tolist():
        view = views[index]
        apart = all(view.name != other.name or abs(view.index - other.index) > 4 for other in chosen)
        if areas[index] and apart and len(chosen) < count:
            chosen.append(view)
    return chosen
