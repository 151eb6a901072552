"""``instdrive find-objects``: instances of a finished scene, from photos and their masks."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg

from instdrive_core.errors import OptionError


def find_objects_in_photos(
    scene: Positional[Path],
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    *,
    photos: Path | None = None,
    masks: str = "",
    replace: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    look: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Find the objects of a finished scene in photos and their masks.

    Splats stay as they are but for their instance. The folder that is written gets a project of the scene with the
    objects as its last edit. What was stopped or killed goes on where it was when the same command is given again.

    Args:
        scene: Scene file, run folder, or project.
        out: Folder of the job and the project.
        photos: Folder with photos and poses, as `train` takes it; default: those that the scene names.
        masks: Folder of masks or of label maps, or a source that makes masks now: `exact`, `annotations`, `lidar`,
            `sam`. Default: masks that are there, else the best that can be made.
        replace: Replace the instances that are there. Else only splats of none get one.
        look: Find nothing; print as JSON what the photos are.
    """
    if look:
        from instdrive_core.jobs.find_source import locate_photos, look_at_photos
        from instdrive_core.jobs.find_stages import locate_scene

        base = locate_scene(scene)
        found = look_at_photos(base, locate_photos(base, "" if photos is None else str(photos)))
        print(json.dumps(asdict(found)))
        return
    if out is None:
        raise OptionError("--out is missing: give the folder of the job and the project, e.g. -o objects")
    from instdrive_core.cli.making.job_printer import JobPrinter
    from instdrive_core.jobs.find_source import MADE
    from instdrive_core.jobs.job_file import JobRequest, locate_project
    from instdrive_core.jobs.run_job import run_job

    is_source = masks in ("", "own", *MADE)
    request = JobRequest(
        str(scene.resolve()),
        kind="find-objects",
        clip="" if photos is None else str(photos.resolve()),
        masks=masks if is_source else str(Path(masks).resolve()),
        replaces=replace,
    )
    state = run_job(out, request, JobPrinter().show)
    if state.status == "stopped":
        print(f"stopped; the same command goes on (--out {out})")
    elif locate_project(out).is_file():
        print(f"scene: {locate_project(out)} (open it with: instdrive edit {locate_project(out)})")
