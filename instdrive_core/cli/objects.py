"""``instdrive objects``: boxes, hulls and ways of a scene's instances, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from instdrive_core.cli.arguments import choose_time
from instdrive_core.formats.objects.writers import Shape, check_suffix, write_objects
from instdrive_core.project.open import open_edited_scene
from instdrive_core.recording.ego_path import find_ego_way
from instdrive_core.wording import format_count


def export_objects(
    scene: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])],
    shape: Shape = "box",
    time: float | None = None,
) -> None:
    """Write boxes or hulls of a scene's instances as .json or .glb, or the ways of what drives as .xosc.

    Args:
        scene: Scene file, run folder, or project; of a project, what its edits made of the scene.
        out: File to write: .json has names, classes, boxes and tracks; .glb is a 3D scene with a node per instance;
            .xosc is an OpenSCENARIO file in which everything that drives, and the recording car, follows its way.
        shape: `hull`: the convex hull of each instance, in a .json beside its box.
        time: Seconds into the drive at which moving objects are shown; default: the first photo's.
    """
    check_suffix(out)
    opened = open_edited_scene(scene)
    time = choose_time(opened, time)
    ways = out.suffix.lower() == ".xosc"
    ego = find_ego_way(opened.views) if ways and opened.views else None
    written = write_objects(out, opened, time, shape, ego)
    if ways:
        print(f"{out}: ways of {format_count(len(written), 'object')}{' and of the recording car' if ego else ''}")
        return
    print(f"{out}: {len(written)} object{'s' * (len(written) != 1)}{f' at {time:g} s' if opened.actors else ''}")
    absent = sum(not entry.present for entry in written)
    if absent:
        print(f"{absent} of them are not there at this time ('present' is false); they stand where their track ends")
    missing = len(opened.table) - len(written)
    if missing:
        print(f"{missing} instances are left out: no splat left, or not there at this time")
    flat = sum(shape == "hull" and entry.hull is None for entry in written)
    if flat:
        print(f"{flat} objects span no volume and are boxes")
