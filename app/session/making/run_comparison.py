"""Measured runs side by side: which are known, which are compared, and the table of their figures."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from instdrive_app.session.context import SessionContext
from instdrive_app.session.files.recents import RecentFiles
from instdrive_app.session.making.child import run_command

RUN_FACTS = "run.json"
"""File that a finished run has."""


@dataclass(frozen=True)
class FigureCell:
    """One run's value of one figure."""

    text: str
    delta: str
    """Difference to the first run; empty for the first."""
    best: bool


@dataclass(frozen=True)
class RunTable:
    """Figures by rows, runs by columns."""

    names: tuple[str, ...]
    rows: tuple[tuple[str, tuple[FigureCell, ...]], ...]
    """Title of each figure and its values."""
    notes: tuple[str, ...]
    """What makes the runs incomparable."""


class RunComparison:
    """Compares runs in a process of its own, which also evaluates those that nobody has measured yet."""

    def __init__(self, context: SessionContext, jobs: RecentFiles, opened: RecentFiles) -> None:
        """`jobs` and `opened` list the folders among which runs are looked for."""
        self._context, self._jobs, self._opened = context, jobs, opened
        self.chosen: set[Path] = set()
        self.table: RunTable | None = None
        """Figures of the runs compared last; None before that."""
        self.is_busy = False

    def list_runs(self) -> tuple[Path, ...]:
        """List the finished runs among what was made and opened, newest first."""
        paths = dict.fromkeys((*self._jobs.paths, *self._opened.paths))
        return tuple(path for path in paths if (path / RUN_FACTS).is_file())

    def compare(self) -> None:
        """Compare the chosen runs in the background; `table` has the result."""
        runs = [str(run) for run in self.list_runs() if run in self.chosen]
        if not runs or self.is_busy:
            return
        self.is_busy = True

        def work() -> RunTable:
            with TemporaryDirectory() as folder:
                file = Path(folder) / "table.json"
                run_command("compare", *runs, "--json", str(file))
                return _read_table(file)

        def keep(table: RunTable) -> None:
            self.table, self.is_busy = table, False

        def end(error: BaseException) -> bool:
            self.is_busy = False
            return False

        self._context.jobs.submit_in_background("Comparing runs", work, keep, end)


def _read_table(file: Path) -> RunTable:
    content = json.loads(file.read_text(encoding="utf-8"))
    rows = tuple((row["title"], tuple(FigureCell(**cell) for cell in row["cells"])) for row in content["rows"])
    return RunTable(tuple(content["names"]), rows, tuple(content["notes"]))
