"""How well ground is filled in where a parked car was: against the street ray-traced without that car.

`python -m benchmarks.fill_hole` takes a scene trained from the synthetic street of seed 7 (the sample scene),
deletes each large parked car, and compares the ground that this uncovers, in the photos that show most of the car,
with the truth, before and after the fill. Prints one JSON line: PSNR (dB), mean error of colours blurred over 8 pixels.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from instdrive_app.files.sample import find_sample_scene
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.sensors.render import StepRenderer
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.light import Light
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.edits.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import open_scene
from instdrive_core.instances.table import Instance
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.scene import Scene

GROUND_LABELS = (1, 2, 3, 4)
"""Classes of the synthetic street's ground: road, marks, kerbs and pavements."""
BLUR = 8.0
"""Pixels: texture that is elsewhere than in truth is no error, another brightness is."""
NEAREST = 1.2
"""Metres between an instance's middle and the car of the street that it is taken for."""


@dataclass(frozen=True)
class Options:
    """Compare fills with truth."""

    scene: Path | None = None
    """Trained from the street; default: the sample scene."""
    seed: int = 7
    """Seed of the street."""
    min_splats: int = 1200
    """Smaller cars are left out."""
    views: int = 3
    """Photos per car."""


@dataclass(frozen=True)
class Uncovered:
    """One photo's part that a deletion uncovers."""

    view: CameraView
    truth: Float32[ndarray, "h w 3"]
    """The street without the car."""
    ground: Bool[ndarray, "h w"]
    """Pixels that showed the car and would show ground."""


def list_uncovered(scene: Scene, street: Street, car: int, views: list[CameraView]) -> Iterator[Uncovered]:
    """The truth behind actor number `car` of the street; photos without ground behind it are left out."""
    inverse = np.linalg.inv(street.world_from_street())
    without = replace(street, actors=tuple(actor for n, actor in enumerate(street.actors) if n != car))
    for view in views:
        pose = view.camera.world_from_camera.copy()
        pose[:3, 3] += scene.origin
        camera = replace(view.camera, world_from_camera=inverse @ pose)
        full, free = (_photograph(each, camera, view.time, street.light) for each in (street, without))
        ground = (full[1] == street.actor_id(car)) & np.isin(free[1], GROUND_LABELS)
        if ground.sum() > 50:
            yield Uncovered(view, free[0].astype(np.float32) / 255, ground)


def _photograph(
    street: Street, camera: Camera, time: float, light: Light
) -> tuple[UInt8[ndarray, "h w 3"], UInt8[ndarray, "h w"]]:
    photo = StepRenderer(street.geometry(time), street.materials, light).photograph(camera)
    return photo.image, photo.labels


def find_parked_car(scene: Scene, street: Street, instance: Instance) -> int | None:
    """The street's actor that an instance is; None where none stands there."""
    middle = np.mean(instance.bounds, axis=0) + scene.origin
    distances = {
        number: float(np.linalg.norm(((street.world_from_street() @ street.box_pose(actor, 0))[:3, 3] - middle)[:2]))
        for number, actor in enumerate(street.actors)
        if actor.route.speed == 0
    }
    nearest = min(distances, key=lambda number: distances[number], default=None)
    return nearest if nearest is not None and distances[nearest] < NEAREST else None


def best_views(scene: Scene, instance: int, count: int) -> list[CameraView]:
    """The photos that show most of an instance, from different places."""
    areas = []
    for view in scene.views:
        ids = build_instance_map(scene, view_scene(scene, view.camera, view.time))
        areas.append(int((ids == instance).sum()))
    chosen: list[CameraView] = []
    for index in np.argsort(areas)[::-1]:
        view = scene.views[index]
        if len(chosen) < count and all(view.name != c.name or abs(view.index - c.index) > 4 for c in chosen):
            chosen.append(view)
    return chosen


def errors(scene: Scene, part: Uncovered) -> tuple[float, float]:
    """Mean squared error of the uncovered ground, and the mean error of blurred colours."""
    shown = view_scene(scene, part.view.camera, part.view.time).color.clip(0, 1)
    difference = shown - part.truth
    weight = gaussian_filter(part.ground.astype(np.float32), BLUR)
    blurred = [gaussian_filter(difference[..., c] * part.ground, BLUR) / np.maximum(weight, 1e-6) for c in range(3)]
    return float((difference[part.ground] ** 2).mean()), float(np.abs(np.stack(blurred, -1)[part.ground]).mean())


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    path = options.scene or find_sample_scene()
    scene, street = open_scene(path), build_street(StreetConfig(seed=options.seed))
    before, after, cars = [], [], 0
    for instance in list(scene.table):
        if instance.class_name != "Car" or instance.node or instance.count < options.min_splats:
            continue
        car = find_parked_car(scene, street, instance)
        parts = (
            []
            if car is None
            else list(list_uncovered(scene, street, car, best_views(scene, instance.id, options.views)))
        )
        if not parts:
            continue
        cars += 1
        document = Document(open_scene(path))
        document.apply(DeleteInstances((instance.id,)))
        report = report_deletion(document, (instance.id,), 0.0)
        gone = bake_document(document)
        before += [errors(gone, part) for part in parts]
        for edit in (report.make_absorb_edit(), report.make_fill_edit()):
            if edit is not None:
                document.apply(edit)
        filled = bake_document(document)
        after += [errors(filled, part) for part in parts]
    figures = {}
    for name, measured in (("before", before), ("after", after)):
        squared, blurred = np.mean(measured, axis=0)
        figures |= {
            f"psnr_{name}": round(float(-10 * np.log10(squared)), 2),
            f"blurred_{name}": round(float(blurred), 3),
        }
    return {"cars": cars, "views": len(before), **figures}


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Options))))
