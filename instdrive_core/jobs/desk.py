"""Where a running job keeps its state: it writes the file now and then, and does what others ask of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from instdrive_core.jobs.job_file import CurvePoint, JobStage, JobState, StageStatus, Status, read_wish, write_job_state
from instdrive_core.progress import CancelledError

WRITE_SECONDS = 0.5
"""Least time between two writes of the state."""
MOST_POINTS = 400
"""Points of the curves; where there are more, every other one is left out."""
_HOLD_SECONDS = 0.2


class JobStoppedError(CancelledError):
    """The job was asked to stop; it can go on later."""


@dataclass
class JobDesk:
    """The state of a running job. Its methods raise JobStoppedError where the job is to stop."""

    run: Path
    state: JobState
    on_change: Callable[[JobState], None] = lambda state: None
    """Is told each state that is written."""
    is_stopping: bool = False
    """Set from outside, e.g. by a signal: the next report stops the job."""
    _written: float = 0.0
    _since: float = field(default_factory=time.monotonic)
    """When the stage's seconds were last counted."""
    _begun: tuple[float, float] | None = None
    """Share and moment from which the speed of the present step is measured."""

    def change(self, *, now: bool = False, status: Status | None = None, **values: object) -> None:
        """Change fields of the state and write it where that is due, or `now`."""
        if status is not None:
            values["status"] = status
        self.state = replace(self.state, **values)
        if now or time.monotonic() - self._written >= WRITE_SECONDS:
            write_job_state(self.run, self.state)
            self._written = time.monotonic()
            self.on_change(self.state)

    def begin(self, name: str) -> None:
        """Begin a stage, or go on with it."""
        self._since, self._begun = time.monotonic(), None
        self._set_stage(name, "running", None)
        self.change(now=True, doing="", seconds_left=None)
        self.check()

    def end(self, name: str) -> None:
        """Note that a stage is done."""
        self._count_seconds(name)
        self._set_stage(name, "done", 1.0)
        self.change(now=True, doing="", seconds_left=None)

    def note(self, text: str) -> None:
        """Tell the user something."""
        self.change(notes=(*self.state.notes, text), now=True)

    def advance(self, doing: str, share: float | None = None) -> None:
        """Report what the running stage does and how much of that is done."""
        stage, moment = self.state.stage, time.monotonic()
        left = None
        if doing.split(":")[0] != self.state.doing.split(":")[0] or self._begun is None:
            self._begun = None if share is None else (share, moment)
        elif share is not None and share > self._begun[0]:
            left = (1 - share) * (moment - self._begun[1]) / (share - self._begun[0])
        if stage is not None:
            self._count_seconds(stage.name)
            self._set_stage(stage.name, "running", share)
        self.change(doing=doing, seconds_left=left)
        self.check()

    def add_point(self, point: CurvePoint) -> None:
        """Add a point to the curves; points that a resumed training does again are replaced."""

        def stands(other: CurvePoint) -> bool:
            return other.stage != point.stage or other.iteration < point.iteration

        kept = [other for other in self.state.curve if stands(other)]
        if len(kept) >= MOST_POINTS:
            kept = kept[::2]
        self.change(curve=(*kept, point))

    def check(self) -> None:
        """Do what was asked: hold until the job is to go on, or raise JobStoppedError."""
        wish = "stop" if self.is_stopping else read_wish(self.run)
        if wish == "pause":
            began = time.monotonic()
            self.change(now=True, status="paused")
            while (wish := "stop" if self.is_stopping else read_wish(self.run)) == "pause":
                time.sleep(_HOLD_SECONDS)
            held = time.monotonic() - began
            self._since += held
            self._begun = None if self._begun is None else (self._begun[0], self._begun[1] + held)
            if wish != "stop":
                self.change(now=True, status="running")
        if wish == "stop":
            raise JobStoppedError("The job was stopped; it can go on later")

    def _count_seconds(self, name: str) -> None:
        moment = time.monotonic()
        spent, self._since = moment - self._since, moment
        self.state = replace(
            self.state,
            stages=tuple(
                replace(stage, seconds=stage.seconds + spent) if stage.name == name else stage
                for stage in self.state.stages
            ),
        )

    def _set_stage(self, name: str, status: StageStatus, share: float | None) -> None:
        def update(stage: JobStage) -> JobStage:
            return replace(stage, status=status, share=share) if stage.name == name else stage

        self.state = replace(self.state, stages=tuple(map(update, self.state.stages)))
