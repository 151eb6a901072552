"""How well objects are found in scenes whose instances were taken away.

`python -m benchmarks.find_objects [--scenes SCENE …]` strips all IDs and moving objects' frames off trained scenes, at
one moment, finds objects as *Labels → Find objects* does, and compares them with the IDs that the scenes had. Prints
one JSON line: for each scene the mean over things (everything but ground, buildings, vegetation and what has no class;
of at least `--min-support`) of the intersection over union with the object that shares most of it, weighted by opacity;
the share of things above 0.5; the share of found objects that are mostly a thing; and seconds.

The IDs compared with are those that training learned from masks: mistakes of theirs count against the objects.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float, UInt32
from numpy import ndarray

from benchmarks.workload import ROOT
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import EditError, InstDriveError
from instdrive_core.formats.registry import open_scene
from instdrive_core.instances.table import InstanceTable

STUFF = ("", "Road", "Sidewalk", "Ground", "Building", "Vegetation", "Road Marks")
"""Classes of background."""


@dataclass(frozen=True)
class Options:
    """Strip instances, find objects, compare."""

    scenes: tuple[Path, ...] = (ROOT / "assets" / "sample_scene",)
    """Trained scenes or runs with instances and classes."""
    time: float = 1.0
    """Seconds into the drive at which moving objects stand still."""
    min_support: float = 30.0
    """Things whose opacities sum to less are left out."""


def measure_overlaps(
    found: UInt32[ndarray, " n"], truth: UInt32[ndarray, " n"], weights: Float[ndarray, " n"], things: list[int]
) -> list[float]:
    """Intersection over union of each thing with the found object that shares most of it; 0 where none does."""
    sizes, overlaps = np.bincount(found, weights), []
    for thing in things:
        own = truth == thing
        shared = np.bincount(found[own], weights[own], len(sizes))
        shared[0] = 0
        best = int(shared.argmax())
        union = weights[own].sum() + sizes[best] - shared[best]
        overlaps.append(float(shared[best] / union) if shared[best] > 0 else 0.0)
    return overlaps


def measure_scene(path: Path, options: Options) -> dict[str, float | int]:
    """Figures of one scene."""
    scene = bake_document(Document(open_scene(path)), options.time)
    truth, weights = scene.instance_ids.copy(), scene.gaussians.opacities.astype(np.float64)
    support = np.bincount(truth, weights)
    named = {entry.id for entry in scene.table if entry.class_name not in STUFF}
    things = sorted(number for number in named if support[number] >= options.min_support)
    scene.instance_ids = np.zeros(len(scene), np.uint32)
    scene.table = InstanceTable()
    document, start = Document(scene), time.perf_counter()
    with contextlib.suppress(EditError):  # none was found, and that is what is measured
        document.apply(FindObjects())
    seconds = time.perf_counter() - start
    found = document.scene.instance_ids
    overlaps = measure_overlaps(found, truth, weights, things)
    mostly = [int(np.bincount(truth[found == entry.id], weights[found == entry.id]).argmax()) for entry in scene.table]
    return {
        "splats": len(scene),
        "things": len(things),
        "found": len(scene.table),
        "thing_miou": round(float(np.mean(overlaps)), 3) if overlaps else 0.0,
        "things_above_half": round(float(np.mean(np.array(overlaps) > 0.5)), 3) if overlaps else 0.0,
        "found_that_are_things": round(float(np.mean([i in named for i in mostly])), 3) if mostly else 0.0,
        "seconds": round(seconds, 2),
    }


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    return {"time": options.time, "scenes": {str(path): measure_scene(path, options) for path in options.scenes}}


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
