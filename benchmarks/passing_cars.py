"""What deleted moving vehicles leave on the ground, against photos of the same street without them.

`python -m benchmarks.passing_cars` trains synthetic streets, deletes each moving vehicle, absorbs its residue, fills
its hole, and compares photos of all times, those of held-out time steps included, with the street ray-traced
without it.

Prints one JSON line, means over vehicles: PSNR (dB), and how much too dark and too bright the ground is, blurred over 8
pixels (0 to 1). `near` is ground within 2 m of the vehicle at the photo's time that some training photo shows at some
time, `shadow` what its shadow darkens of this, `way` such ground within 2 m of where it is at other times; `unseen` is
ground of either kind that no training photo shows, `elsewhere` other ground of the same photos, `beyond` what the
vehicle hides besides ground. `_before` are the same of the street as trained, with the vehicle deleted only.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray
from PIL import Image

from benchmarks.hole_streets import GROUND, LEAST_LIT, photograph, train_street
from benchmarks.seen_truth import find_seen_pixels, hit_pixels, place_camera
from benchmarks.uncovered import LEAST, blur_inside, draw_photo
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import EditError, InstDriveError
from instdrive_core.formats.registry import open_scene
from instdrive_core.instances.table import Instance
from instdrive_core.instances.vehicles import is_vehicle
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.training.settings.config import Preset

SEEDS = (71, 72, 73)
"""Streets on which nothing was chosen."""
AROUND = 2.0
"""Metres around a vehicle within which ground is compared."""
FARTHEST = 40.0
"""Metres from the camera within which ground is compared."""
PARTS = ("near", "way", "shadow", "unseen", "elsewhere", "beyond")


@dataclass(frozen=True)
class Options:
    """Delete moving vehicles, compare."""

    folder: Path | None = None
    """Where streets and runs are kept, and taken from where they are there; default: a temporary folder."""
    seeds: tuple[int, ...] = SEEDS
    preset: Preset = "demo"
    views: int = 10
    """Photos per vehicle, those that show most of the ground around its way."""
    pictures: Path | None = None
    """Folder for pictures of each vehicle: photo, truth without it, deleted, cleaned up."""


@dataclass(frozen=True)
class FreePhoto:
    """A photo, what it would show without a vehicle, and the pixels that are compared."""

    view: CameraView
    photo: Float32[ndarray, "h w 3"]
    truth: Float32[ndarray, "h w 3"]
    """Colours in [0, 1]."""
    parts: dict[str, Bool[ndarray, "h w"]]


@dataclass
class Tally:
    """Errors of one part over all photos of one vehicle."""

    squared: float = 0.0
    dark: float = 0.0
    bright: float = 0.0
    pixels: int = 0

    def add(self, difference: Float32[ndarray, "h w 3"], inside: Bool[ndarray, "h w"]) -> None:
        """Count a photo's pixels."""
        blurred = blur_inside(difference, inside)[inside].mean(axis=1)
        self.squared += float((difference[inside] ** 2).mean(axis=1).sum())
        self.dark += float(np.maximum(-blurred, 0).sum())
        self.bright += float(np.maximum(blurred, 0).sum())
        self.pixels += int(inside.sum())

    def summarize(self) -> dict[str, float]:
        """PSNR in dB, and the mean errors."""
        psnr = -10 * np.log10(max(self.squared / self.pixels, 1e-10))
        return {"psnr": float(psnr), "dark": self.dark / self.pixels, "bright": self.bright / self.pixels}


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    before: list[dict[str, Tally]] = []
    after: list[dict[str, Tally]] = []
    with tempfile.TemporaryDirectory() as temporary:
        for seed in options.seeds:
            print(f"street {seed}", file=sys.stderr, flush=True)
            config = StreetConfig(seed=seed)
            run = train_street(config, (options.folder or Path(temporary)) / f"street-{seed}", options.preset)
            scene, street = open_scene(run), build_street(config)
            clip = load_clip(str(run.parent / "street"), ClipOptions(scale=1.0))
            for instance, actor in list_moving_vehicles(scene, street):
                photos = list_free_photos(clip, street, actor, options)
                if not photos:
                    continue
                gone, clean = delete_vehicle(scene, instance)
                before.append(measure(gone, photos))
                after.append(measure(clean, photos))
                shown = {part: f"{t.summarize()['psnr']:.1f}/{t.dark / t.pixels:.3f}" for part, t in after[-1].items()}
                print(f"{seed}-{instance.id} {instance.name}", shown, file=sys.stderr, flush=True)
                if options.pictures is not None:
                    save_pictures(options.pictures / f"{seed}-{instance.id}.png", photos, gone, clean)
    return {
        **summarize(after),
        **{f"{name}_before": value for name, value in summarize(before).items()},
        "vehicles": len(after),
        "photos": options.views,
    }


def list_moving_vehicles(scene: Scene, street: Street) -> Iterator[tuple[Instance, int]]:
    """The instances that are moving vehicles, and their numbers among the actors of the street."""
    numbers = {str(actor.uuid): number for number, actor in enumerate(street.actors)}
    for instance in scene.table:
        if instance.node and is_vehicle(instance) and scene.actors[instance.node - 1].id in numbers:
            yield instance, numbers[scene.actors[instance.node - 1].id]


def list_free_photos(clip: Clip, street: Street, actor: int, options: Options) -> list[FreePhoto]:
    """The photos that show most of the ground around a vehicle's way, and the same without it; kept beside the clip."""
    track = next(each for each in clip.tracks if each.id == str(street.actors[actor].uuid))
    views = choose_views(clip, track, options.views)
    if not views:
        return []
    kept = Path(clip.path) / "labels" / "free" / f"{actor}-{options.views}.npz"
    if not kept.is_file():
        kept.parent.mkdir(exist_ok=True)
        np.savez_compressed(kept, **_take_free_photos(clip, street, actor, track, views))
    with np.load(kept) as file:
        arrays = {name: file[name] for name in ("photo", "truth", *PARTS)}
    colors = [arrays[name].astype(np.float32) / 255 for name in ("photo", "truth")]
    return [
        FreePhoto(view, colors[0][number], colors[1][number], {part: arrays[part][number] for part in PARTS})
        for number, view in enumerate(views)
    ]


def _take_free_photos(clip: Clip, street: Street, actor: int, track: Track, views: list[CameraView]) -> dict[str, Any]:
    free_street = replace(street, actors=tuple(each for number, each in enumerate(street.actors) if number != actor))
    found = [_take_free_photo(clip, street, free_street, actor, track, view) for view in views]
    asked = [each["near"] | each["way"] for each in found]
    for each, seen in zip(found, find_seen_pixels(street, free_street, clip, views, asked), strict=True):
        each["unseen"] = (each["near"] | each["way"]) & ~seen
        for part in ("near", "way", "shadow"):
            each[part] &= seen
    return {
        name: np.stack([each[name] for each in found]) if found else np.zeros(shape)
        for name in ("photo", "truth", *PARTS)
    }


def _take_free_photo(
    clip: Clip, street: Street, free_street: Street, actor: int, track: Track, view: CameraView
) -> dict[str, ndarray]:
    classes = np.array(["", *(fixture.label for fixture in street.fixtures)])
    poses = np.stack([street.box_pose(street.actors[actor], time) for time in track.times])
    half = street.actors[actor].dimensions / 2
    camera = place_camera(street, clip, view.camera)
    full, free = (photograph(each, camera, view.time, street.light) for each in (street, free_street))
    shape = full[1].shape
    rows, columns = (each.ravel() for each in np.indices(shape))
    points, _ = hit_pixels(free_street, camera, view.time, rows, columns)
    close = (np.linalg.norm(points - camera.position, axis=1) < FARTHEST).reshape(shape)
    behind = classes[np.where(free[1] < len(classes), free[1], 0)]
    ground = np.isin(behind, GROUND) & close
    hidden = full[1] == street.actor_id(actor)
    now = is_around(points, street.box_pose(street.actors[actor], view.time)[None], half).reshape(shape)
    now &= track.covers(view.time)
    ever = is_around(points, poses, half).reshape(shape)
    darker = (free[0].mean(axis=2) - full[0].mean(axis=2)) / 255 >= LEAST_LIT
    return {
        "photo": full[0],
        "truth": free[0],
        "near": ground & now,
        "way": ground & ever & ~now,
        "shadow": ground & now & ~hidden & darker & (full[1] == free[1]),
        "elsewhere": ground & ~ever & ~now & ~hidden & ~darker & (full[1] == free[1]),
        "beyond": hidden & ~ground & (behind != ""),
    }


def choose_views(clip: Clip, track: Track, count: int) -> list[CameraView]:
    """The photos in which the ground below the way is largest, by rising time; no two of a camera within two steps."""
    half = track.dimensions / 2
    corners = np.array([[x, y, -half[2], 1] for x in (-half[0], half[0]) for y in np.linspace(-half[1], half[1], 5)])
    path = (track.world_from_box @ corners.T).transpose(0, 2, 1)[..., :3].reshape(-1, 3)
    views, areas = [frame.view for frame in clip.frames], []
    for view in views:
        pixels, depths = view.camera.project(path)
        framed = view.camera.contains(pixels, depths, 0.5) & (depths < FARTHEST)
        areas.append(float((1 / np.maximum(depths[framed], 3) ** 2).sum()))
    chosen: list[CameraView] = []
    for number in np.argsort(-np.array(areas), kind="stable").tolist():
        view = views[number]
        apart = all(view.name != other.name or abs(view.index - other.index) > 2 for other in chosen)
        if areas[number] > 0 and apart and len(chosen) < count:
            chosen.append(view)
    return sorted(chosen, key=lambda view: (view.time, view.name))


def is_around(
    points: Float64[ndarray, "n 3"], poses: Float64[ndarray, "t 4 4"], half: Float64[ndarray, "3"]
) -> Bool[ndarray, " n"]:
    """Whether points are within `AROUND` of the box, seen from above, in any of its poses."""
    found = np.zeros(len(points), bool)
    for pose in poses:
        local = (points - pose[:3, 3]) @ pose[:3, :2]
        found |= np.hypot(*np.maximum(np.abs(local) - half[:2], 0).T) < AROUND
    return found


def delete_vehicle(scene: Scene, instance: Instance) -> tuple[Scene, Scene]:
    """The scene without the vehicle, deleted only and cleaned up as the editor offers it."""
    document = Document(deepcopy(scene))
    document.apply(DeleteInstances((instance.id,)))
    gone = bake_document(document)
    track = scene.actors[instance.node - 1]
    report = report_deletion(document, (instance.id,), float(track.times[len(track.times) // 2]))
    print(report.summary, file=sys.stderr)
    for edit in (report.make_absorb_edit(), *report.make_fill_edits()):
        try:
            if edit is not None:
                document.apply(edit)
        except EditError as error:
            print(f"refused: {error}", file=sys.stderr)
    return gone, bake_document(document)


def measure(scene: Scene, photos: list[FreePhoto]) -> dict[str, Tally]:
    """Compare a scene with what photos would show, by part; parts that no photo shows are left out."""
    found: dict[str, Tally] = {}
    for photo in photos:
        difference = draw_photo(scene, find_view(scene, photo.view)) - photo.truth
        for name, inside in photo.parts.items():
            if inside.sum() >= LEAST:
                found.setdefault(name, Tally()).add(difference, inside)
    return found


def find_view(scene: Scene, view: CameraView) -> CameraView:
    """Find a photo's view where training found its camera."""
    return next(each for each in scene.views if (each.name, each.index) == (view.name, view.index))


def summarize(vehicles: list[dict[str, Tally]]) -> dict[str, float]:
    """Means over vehicles, by the names of the JSON line."""
    figures: dict[str, float] = {}
    for part in PARTS:
        values = [each[part].summarize() for each in vehicles if part in each]
        for key, digits in (("psnr", 2), ("dark", 4), ("bright", 4)):
            if values:
                figures[f"{part}_{key}"] = round(float(np.mean([each[key] for each in values])), digits)
    return figures


def save_pictures(path: Path, photos: list[FreePhoto], gone: Scene, clean: Scene) -> None:
    """Write the photos of a vehicle, one a row: photo, truth, deleted, cleaned up."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    for photo in photos:
        drawn = [draw_photo(scene, find_view(scene, photo.view)) for scene in (gone, clean)]
        rows.append(np.hstack([photo.photo, photo.truth, *drawn]))
    Image.fromarray((np.vstack(rows) * 255).round().astype(np.uint8)).save(path)


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
