"""What commands that run a job share: the check of its length, and the lines that they print."""

from __future__ import annotations

from typing import TYPE_CHECKING

from instdrive_core.errors import OptionError

if TYPE_CHECKING:
    from instdrive_core.jobs.job_file import JobState


def check_length(minutes: float, iterations: int | None) -> None:
    """Check how long a job is to be. Raises OptionError."""
    if not 0 < minutes < 100_000:
        raise OptionError(f"--minutes is {minutes:g}; it must be more than 0")
    if iterations is not None and iterations < 1:
        raise OptionError(f"--iterations is {iterations}; it must be 1 or more")


class JobPrinter:
    """Prints a line for each stage and note, and now and then how far a stage is."""

    def __init__(self) -> None:
        self._stage, self._notes, self._doing = "", 0, ""

    def show(self, state: JobState) -> None:
        """Print what is new."""
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
