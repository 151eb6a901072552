"""``instdrive make``: photos, a video or a drive become a measured scene in one go."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg

from instdrive_core.errors import OptionError


def make_scene(
    source: Positional[Path],
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    *,
    minutes: float = 20.0,
    iterations: int | None = None,
    no_eval: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    look: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Make a scene of photos, a video or a drive: poses, masks, training and evaluation in one go.

    What was stopped or killed goes on where it was when the same command is given again.

    Args:
        source: Video, folder of photos, or folder of a driving clip.
        out: Folder of the run; `instdrive edit` opens it.
        minutes: How long all of it may take on this machine; some training steps are timed to find out how many fit.
        iterations: Training steps, instead of as many as the minutes allow.
        no_eval: Leave the evaluation out.
        look: Make nothing; print as JSON what the source is.
    """
    from instdrive_core.jobs.source import look_at_source

    if look:
        print(json.dumps(asdict(look_at_source(source))))
        return
    if out is None:
        raise OptionError("--out is missing: give the folder of the run, e.g. -o runs/street")
    from instdrive_core.cli.making.job_printer import JobPrinter, check_length
    from instdrive_core.jobs.job_file import JobRequest
    from instdrive_core.jobs.run_job import run_job

    check_length(minutes, iterations)
    printer = JobPrinter()
    request = JobRequest(str(source.resolve()), minutes, iterations, not no_eval)
    state = run_job(out, request, printer.show)
    if state.status == "stopped":
        print(f"stopped; the same command goes on (--out {out})")
    else:
        print(f"scene: {out} (open it with: instdrive edit {out})")
