"""How good the fill is behind wide things, against the same street without them.

`python -m benchmarks.gaps RUN…` takes runs of synthetic streets, trained with any masks. It deletes each hedge, fence,
tree crown or row of things whose deletion leaves a gap and no hole in the ground, absorbs the residue, fills the gap,
and compares what that uncovers with the street ray-traced without what photos showed there. Without runs it trains
the streets of `benchmarks.holes`.

Prints one JSON line, medians over things: PSNR (dB) of pixels that showed the thing and would show something solid,
or the sky; the mean error of the former's colours blurred over 8 pixels; seconds per thing; and how many lost by the
fill. `_before` are the same before clean-up and fill.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Int32, Int64
from numpy import ndarray

from benchmarks.deletions import Deletion, Result, delete_and_fill, save_comparison
from benchmarks.hole_streets import count_instance_pixels, photograph, spread_views, train_street
from benchmarks.holes import SEEDS
from benchmarks.uncovered import LEAST, Errors, Uncovered, take_median
from instdrive_core.datasets.synthetic.config import CONFIG_FILE, StreetConfig
from instdrive_core.datasets.synthetic.units import read_street_config
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.errors import InstDriveError
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.formats.registry import open_scene
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.training.run import FACTS
from instdrive_core.training.settings.config import Preset

MAIN_SHARE = 0.5
"""Share of a fixture's pixels that must show an instance for it to be what the instance stands for."""


@dataclass(frozen=True)
class Options:
    """Delete wide things, fill, compare."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Runs of synthetic streets; default: streets trained with exact masks."""
    folder: Path | None = None
    """Where streets trained here are kept, and taken from where they are there; default: a temporary folder."""
    preset: Preset = "quick"
    min_splats: int = 400
    """Smaller instances are left out."""
    views: int = 3
    """Photos per thing."""
    pictures: Path | None = None
    """Folder for pictures of each thing: truth, deleted, filled."""


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    result = Result()
    with tempfile.TemporaryDirectory() as temporary:
        for run in options.runs or _train_streets(options, options.folder or Path(temporary)):
            print(run, file=sys.stderr, flush=True)
            _measure_run(run, options, result)
    pairs = [
        (before["solid"].psnr, after["solid"].psnr)
        for before, after in zip(result.before, result.after, strict=True)
        if "solid" in after
    ]
    return {
        **_summarize(result.after),
        **{f"{name}_before": value for name, value in _summarize(result.before).items()},
        "seconds_per_thing": take_median(result.seconds, 2),
        "things": len(pairs),
        "lost": sum(after < before for before, after in pairs),
        "refused": result.refused,
    }


def _train_streets(options: Options, folder: Path) -> Iterator[Path]:
    for seed in SEEDS:
        yield train_street(StreetConfig(seed=seed), folder / f"street-{seed}", options.preset)


def _measure_run(run: Path, options: Options, result: Result) -> None:
    facts = run / FACTS
    config = read_street_config(Path(require_field(facts, read_json(facts), "clip")) / CONFIG_FILE)
    scene, street = open_scene(run), build_street(config)
    pixels = count_instance_pixels(scene)
    for instance in sorted(scene.table, key=lambda each: -each.count):
        if instance.node or instance.count < options.min_splats or not pixels[:, instance.id].any():
            continue
        views = spread_views(scene.views, pixels[:, instance.id], options.views)
        deletion = delete_and_fill(scene, instance.id, views[0].time)
        if not deletion.report.clearings or deletion.report.holes:
            continue
        photos = list(list_without(scene, street, instance.id, views))
        if photos:
            name = f"{run.name}-{instance.id}"
            _compare(name, deletion, photos, result)
            if options.pictures is not None:
                save_comparison(options.pictures / f"{name}.png", deletion, photos)


def list_without(scene: Scene, street: Street, number: int, views: list[CameraView]) -> Iterator[Uncovered]:
    """The truth behind the fixtures that instance `number` stands for; photos that show none of them are left out."""
    inverse, shown = np.linalg.inv(street.world_from_street()), []
    for view in views:
        pose = view.camera.world_from_camera.copy()
        pose[:3, 3] += scene.origin
        camera = replace(view.camera, world_from_camera=inverse @ pose)
        labels = photograph(street, camera, view.time, street.light)[1]
        shown.append((view, camera, labels, build_instance_map(scene, view_scene(scene, view.camera, view.time))))
    fixtures = find_fixtures(street, number, [(labels, ids) for _, _, labels, ids in shown])
    without = remove_fixtures(street, fixtures)
    for view, camera, labels, _ in shown:
        hidden = np.isin(labels, fixtures)
        if hidden.sum() >= LEAST:
            image, free = photograph(without, camera, view.time, street.light)
            yield Uncovered(
                view, image.astype(np.float32) / 255, {"solid": hidden & (free > 0), "sky": hidden & (free == 0)}
            )


def find_fixtures(
    street: Street, number: int, maps: list[tuple[Int32[ndarray, "h w"], Int32[ndarray, "h w"]]]
) -> Int64[ndarray, " k"]:
    """The street's IDs of the fixtures of whose pixels most show instance `number`; `maps` are street and scene IDs."""
    size = len(street.fixtures) + 1
    whole, mine = np.zeros(size, np.int64), np.zeros(size, np.int64)
    for labels, ids in maps:
        whole += np.bincount(labels[labels < size], minlength=size)
        mine += np.bincount(labels[(labels < size) & (ids == number)], minlength=size)
    return np.flatnonzero((mine > MAIN_SHARE * whole) & (np.arange(size) > 0))


def remove_fixtures(street: Street, numbers: Int64[ndarray, " k"]) -> Street:
    """The street without these fixtures; all others keep their IDs."""
    gone = set(numbers.tolist())
    kept = [
        replace(each, mesh=_empty(each.mesh)) if index in gone else each
        for index, each in enumerate(street.fixtures, start=1)
    ]
    return replace(street, fixtures=tuple(kept))


def _empty(mesh: TriangleMesh) -> TriangleMesh:
    return TriangleMesh(mesh.corners[:0], mesh.texcoords[:0], mesh.normals[:0], mesh.materials[:0])


def _compare(name: str, deletion: Deletion, photos: list[Uncovered], result: Result) -> None:
    result.add(name, deletion, photos)
    changes = {
        part: f"{result.before[-1][part].psnr:.1f} → {errors.psnr:.1f} dB" for part, errors in result.after[-1].items()
    }
    print(name, deletion.report.parts[0].name, changes, file=sys.stderr, flush=True)


def _summarize(things: list[dict[str, Errors]]) -> dict[str, float | None]:
    return {
        "solid_psnr": take_median([each["solid"].psnr for each in things if "solid" in each], 2),
        "solid_blur": take_median([each["solid"].blur for each in things if "solid" in each], 3),
        "sky_psnr": take_median([each["sky"].psnr for each in things if "sky" in each], 2),
    }


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
