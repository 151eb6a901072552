"""Boxes and hulls of a scene's instances in files, by the name's ending."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from instdrive_core.errors import DataError
from instdrive_core.formats.objects.json_file import write_objects_json
from instdrive_core.formats.objects.scenario import write_scenario
from instdrive_core.formats.objects.scene_objects import SceneObject, find_scene_objects
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

Shape = Literal["box", "hull"]
SUFFIXES = (".json", ".glb", ".xosc")


def write_objects(
    path: str | Path, scene: Scene, time: float, shape: Shape = "box", ego: Track | None = None
) -> tuple[SceneObject, ...]:
    """Write the scene's instances as oriented boxes or convex hulls, atomically.

    Args:
        path: ``.json``: one entry per instance and every track; ``.glb``: a node per instance, without objects whose
            track does not cover the time; ``.xosc``: an OpenSCENARIO file in which what has a track drives it.
        scene: what to write; of an edited one its `edits.queries.bake.bake_document`, still with its actors.
        time: seconds at which moving objects are shown.
        shape: a hull takes the place of the box in a ``.glb`` and stands beside it in a ``.json``; instances whose
            splats span no volume are boxes.
        ego: way of the recording car, which a ``.xosc`` has, too.

    Returns what was written. Raises DataError for another ending, a time that is no number, or a scene without
    instances, MissingExtraError for ``.xosc`` without the package scenariogeneration.
    """
    path = Path(path)
    check_suffix(path)
    if not math.isfinite(time):
        raise DataError(path, f"the time is {time}", "Give seconds, e.g. 1.5")
    objects = find_scene_objects(scene, time, shape == "hull")
    if not objects:
        raise DataError(path, "the scene has no instances to write", "Train it with masks first")
    if path.suffix.lower() == ".json":
        write_objects_json(path, scene, objects, time)
        return objects
    if path.suffix.lower() == ".xosc":
        driving = tuple(entry for entry in objects if entry.track is not None)
        write_scenario(path, scene, driving, ego)
        return driving
    # Here: trimesh takes half a second to import, and only a .glb needs it.
    from instdrive_core.formats.objects.glb import write_objects_glb

    objects = tuple(entry for entry in objects if entry.present)
    if not objects:
        problem = f"no instance is there at {time:g} s"
        raise DataError(path, problem, "Choose another time, or write a .json, which has all of them")
    write_objects_glb(path, scene, objects, time)
    return objects


def check_suffix(path: Path) -> None:
    """Check a file's ending. Raises DataError where objects cannot be written under this name."""
    if path.suffix.lower() not in SUFFIXES:
        problem = f"objects cannot be written to a file that ends in {path.suffix or 'nothing'!r}"
        raise DataError(path, problem, f"Give a name that ends in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
