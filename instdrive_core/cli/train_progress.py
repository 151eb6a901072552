"""Training on the terminal: one bar per stage with loss, PSNR, Gaussians, speed and time left."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from instdrive_core.training.pieces.drive import run_drive
from instdrive_core.training.run import RunRequest
from instdrive_core.training.settings.events import Event, StageStarted, StepDone

_TITLES = {"rgb": "colour", "instances": "instances"}


class TrainProgress:
    """Shows training events. Where the output is no terminal, a line is printed every 200 steps instead of a bar."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Console()
        self._bar = Progress(
            TextColumn("{task.description:9}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.fields[figures]}"),
            TimeRemainingColumn(),
            console=self.console,
            disable=not self.console.is_terminal,
        )
        self._task: TaskID | None = None
        self._start = (0, 0.0)
        self._psnr: float | None = None
        self._loss: float | None = None

    def __enter__(self) -> TrainProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def on_note(self, note: str) -> None:
        """Print a line above the bar."""
        self.console.print(note, highlight=False, soft_wrap=True)

    def on_event(self, event: Event) -> None:
        """Update the bar."""
        if isinstance(event, StageStarted):
            self._begin(event)
        elif isinstance(event, StepDone) and self._task is not None:
            self._advance(event, self._task)

    def _begin(self, event: StageStarted) -> None:
        if event.message:
            self.on_note(event.message)
        self._start, self._psnr, self._loss = (event.iteration, 0.0), None, None
        self._task = self._bar.add_task(_TITLES[event.stage], total=event.total, completed=event.iteration, figures="")

    def _advance(self, event: StepDone, task: TaskID) -> None:
        if not self._start[1]:
            self._start = (event.iteration, event.seconds)
        steps, seconds = event.iteration - self._start[0], event.seconds - self._start[1]
        speed = steps / seconds if seconds > 0 else 0.0
        self._loss = _smooth(self._loss, event.loss)
        figures = f"loss {self._loss:.4f}"
        if event.psnr is not None:
            self._psnr = _smooth(self._psnr, event.psnr)
            figures += f" · PSNR {self._psnr:.2f} dB"
        figures += f" · {event.gaussians:,} Gaussians · {speed:.1f} it/s"
        self._bar.update(task, completed=event.iteration, figures=figures)
        if not self.console.is_terminal and (event.iteration % 200 == 0 or event.iteration == event.total):
            left = (event.total - event.iteration) / speed if speed else 0.0
            self.on_note(f"{_TITLES[event.stage]} {event.iteration}/{event.total} · {figures} · {left:.0f} s left")


def train_with_progress(request: RunRequest) -> None:
    """Run a training with the bar on the terminal."""
    with TrainProgress() as progress:
        run_drive(request, progress.on_event, progress.on_note)


def _smooth(before: float | None, value: float) -> float:
    return value if before is None else 0.9 * before + 0.1 * value
