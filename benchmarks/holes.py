"""How good the fill behind deleted cars is, against photos of the same street without them.

`python -m benchmarks.holes` trains synthetic streets, deletes each large parked car, absorbs its residue, fills its
hole, and compares what that uncovers with the street ray-traced without the car.

`python -m benchmarks.holes --clip CLIP` does the same on a real drive with phantom cars: boxes on free ground hide
what is behind them from all training photos and sweeps; the photos themselves are the truth.

Prints one JSON line, medians over cars: PSNR (dB) of uncovered ground, of walls behind, of ground in the car's shadow,
the mean error of ground colours blurred over 8 pixels, and seconds per car. `_before` are the same before the fill.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro

from benchmarks.deletions import Result, delete_and_fill, save_comparison
from benchmarks.hole_streets import (
    count_instance_pixels,
    find_parked_car,
    list_uncovered,
    spread_views,
    train_street,
)
from benchmarks.phantom_cars import add_phantom, hide_phantoms, list_phantom_photos, place_phantoms
from benchmarks.uncovered import Uncovered, summarize_errors
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.errors import InstDriveError
from instdrive_core.formats.registry import open_scene
from instdrive_core.masks.annotated.truth import AnnotatedTruth
from instdrive_core.scene.scene import Scene
from instdrive_core.training.run import FACTS, OpenedClip, RunRequest, run_training
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import Preset, build_train_config

SEEDS = (61, 62, 63, 64, 65)
"""Streets on which nothing was chosen."""


@dataclass(frozen=True)
class Options:
    """Delete cars, fill, compare."""

    clip: Path | None = None
    """A real drive with labels, for phantom cars; default: synthetic streets."""
    options: ClipOptions = field(default_factory=ClipOptions)
    folder: Path | None = None
    """Where streets and runs are kept, and taken from where they are there; default: a temporary folder."""
    seeds: tuple[int, ...] = SEEDS
    preset: Preset = "quick"
    phantoms: int = 8
    """Phantom cars on a real drive."""
    min_splats: int = 800
    """Smaller cars of a street are left out."""
    views: int = 3
    """Photos per car."""
    pictures: Path | None = None
    """Folder for pictures of each car: truth, deleted, filled."""


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    with tempfile.TemporaryDirectory() as temporary:
        folder, result = options.folder or Path(temporary), Result()
        cars = _list_street_cars(options, folder) if options.clip is None else _list_phantoms(options, folder)
        for name, scene, number, photos in cars:
            _measure_car(scene, number, photos, result, name, options.pictures)
    before = {f"{name}_before": value for name, value in summarize_errors(result.before).items()}
    return {
        **summarize_errors(result.after),
        **before,
        "seconds_per_car": round(float(np.median(result.seconds)), 2) if result.seconds else None,
        "cars": len(result.after),
        "photos": sum(len(car[part].pixels) for car in result.after for part in car if part == "ground"),
        "refused": result.refused,
    }


Car = tuple[str, Scene, int, list[Uncovered]]
"""A name, the scene, the instance, and photos without it."""


def _list_street_cars(options: Options, folder: Path) -> Iterator[Car]:
    for seed in options.seeds:
        config = StreetConfig(seed=seed)
        print(f"street {seed}", file=sys.stderr, flush=True)
        scene = open_scene(train_street(config, folder / f"street-{seed}", options.preset))
        street, known, pixels = build_street(config), set[int](), count_instance_pixels(scene)
        for instance in sorted(scene.table, key=lambda each: -each.count):
            car = None
            if not instance.node and instance.count >= options.min_splats:
                car = find_parked_car(scene, street, instance)
            if car is not None and car not in known:
                known.add(car)
                views = spread_views(scene.views, pixels[:, instance.id], options.views)
                yield f"{seed}-{instance.id}", scene, instance.id, list(list_uncovered(scene, street, car, views))


def _list_phantoms(options: Options, folder: Path) -> Iterator[Car]:
    assert options.clip is not None
    clip = load_clip(str(options.clip), options.options)
    phantoms = place_phantoms(clip, options.phantoms, np.random.default_rng(0))
    run, hidden = folder / "phantoms", hide_phantoms(clip, phantoms)
    if not (run / FACTS).is_file():
        config = build_train_config("instdrive", options.preset, 0)
        request = RunRequest(
            options.clip, run, options.options, config, resume=run.is_dir(), tracks="annotated", sizes=AskedSizes()
        )
        run_training(request, lambda event: None, lambda note: print(note, file=sys.stderr), OpenedClip(hidden))
    scene, truth = open_scene(run), AnnotatedTruth(clip)
    for number, phantom in enumerate(phantoms):
        photos = list(list_phantom_photos(clip, truth, phantom, options.views))
        yield f"phantom-{number}", *add_phantom(scene, phantom), photos


def _measure_car(
    scene: Scene, number: int, photos: list[Uncovered], result: Result, name: str, pictures: Path | None
) -> None:
    """Delete one car in a copy of the scene, clean up, and compare before and after."""
    if not photos:
        return
    deletion = delete_and_fill(scene, number, photos[0].view.time)
    result.add(name, deletion, photos)
    shown = {part: round(errors.psnr, 2) for part, errors in result.after[-1].items()}
    print(name, f"hole {deletion.report.hole_area:.1f} m²", shown, file=sys.stderr, flush=True)
    if pictures is not None:
        save_comparison(pictures / f"{name}.png", deletion, photos)


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
