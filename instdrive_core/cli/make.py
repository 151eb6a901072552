"""``instdrive make``: photos, a video or a drive become a measured scene in one go."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from instdrive_core.errors import OptionError

if TYPE_CHECKING:
    from instdrive_core.jobs.job_file import JobState


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
    if not 0 < minutes < 100_000:
        raise OptionError(f"--minutes is {minutes:g}; it must be more than 0")
    if iterations is not None and iterations < 1:
        raise OptionError(f"--iterations is {iterations}; it must be 1 or more")
    from instdrive_core.jobs.job_file import JobRequest
    from instdrive_core.jobs.run_job import run_job

    printer = _Printer()
    request = JobRequest(str(source.resolve()), minutes, iterations, not no_eval)
    state = run_job(out, request, printer.show)
    if state.status == "stopped":
        print(f"stopped; the same command goes on (--out {out})")
    else:
        print(f"scene: {out} (open it with: instdrive edit {out})")


class _Printer:
    """Prints a line for each stage and note, and now and then how far a stage is."""

    def __init__(self) -> None:
        self._stage, self._notes, self._doing = "", 0, ""

    def show(self, state: JobState) -> None:
        from instdrive_core.jobs.job_file import describe_seconds

        for note in state.notes[self._notes :]:
            print(f"  {note}", flush=True)
        self._notes = len(state.notes)
        stage = state.stage
        if stage is None:
            return
        if stage.name != self._stage:
            self._stage = stage.name
            print(stage.title, flush=True)
        doing = state.doing.split(":")[0]
        if doing and doing != self._doing:
            self._doing = doing
            left = "" if state.seconds_left is None else f", {describe_seconds(state.seconds_left)} left"
            print(f"  {doing}{left}", flush=True)
