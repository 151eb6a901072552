"""``instdrive improve``: an edited scene trains on, and keeps its edits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg


def improve_scene(
    scene: Positional[Path],
    out: Annotated[Path, arg(aliases=["-o"])],
    *,
    minutes: float = 10.0,
    iterations: int | None = None,
    clip: Path | None = None,
    no_eval: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Train on from an edited scene: what was deleted stays deleted, what was moved or painted stays so.

    The photos are those that the scene was trained on. The folder of the new run holds the scene and, where the given
    one has edits, a project with all of them. What was stopped or killed goes on where it was when the same command is
    given again.

    Args:
        scene: Project, or run folder without edits.
        out: Folder of the new run.
        minutes: How long all of it may take on this machine; some training steps are timed to find out how many fit.
        iterations: Training steps, instead of as many as the minutes allow.
        clip: Where the clip is now, where it was moved since the scene was trained.
        no_eval: Leave the evaluation out.
    """
    from instdrive_core.cli.making.job_printer import JobPrinter, check_length
    from instdrive_core.jobs.job_file import JobRequest, locate_project
    from instdrive_core.jobs.run_job import run_job

    check_length(minutes, iterations)
    request = JobRequest(
        str(scene.resolve()),
        minutes,
        iterations,
        not no_eval,
        kind="improve",
        clip="" if clip is None else str(clip.resolve()),
    )
    state = run_job(out, request, JobPrinter().show)
    if state.status == "stopped":
        print(f"stopped; the same command goes on (--out {out})")
        return
    made = locate_project(out) if locate_project(out).is_file() else out
    print(f"scene: {made} (open it with: instdrive edit {made})")
