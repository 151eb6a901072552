"""The paper's tables and figures: `python -m benchmarks.tables` makes docs/results.md.

Every cell is a process of its own whose outcome is kept under runs/tables, so that a call which was cut off goes on
where it stood; the page is written from whatever outcomes there are. The last line printed is a JSON object.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from benchmarks.cell_queue import Queue
from benchmarks.cell_work import Workplace, commit, end_with_parent, work
from benchmarks.cells import FULL, MINIATURE, Cell, choose_cells
from benchmarks.results_page import NOTES_END, NOTES_START, Results, page
from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.files.atomic import write_bytes

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Options:
    """Make the tables' cells that are not there yet, then the page."""

    only: tuple[str, ...] = ()
    """Cells whose names contain one of these (`*` matches anything), and what they need; default: all but those of
    --full-length."""
    list: bool = False
    """Say which cells there are, which are done, and how long the others are expected to take; do nothing."""
    full_length: bool = False
    """Also train the paper's method for its own 30,000 steps, on the frozen geometry."""
    budget: float | None = None
    """Seconds: no cell starts that is not expected to end within them. 0 writes the page only."""
    jobs: int = 1
    """Processes at a time, of 2 threads each."""
    redo: tuple[str, ...] = ()
    """Forget the outcomes of cells whose names contain one of these, also where their settings are as before."""
    miniature: bool = False
    """Tiny clips and runs, to see in minutes that everything works; the page lies beside its outcomes."""
    pandaset: Path = ROOT.parent / "shared" / "data" / "pandaset" / "002"
    """The recorded clip."""
    folder: Path = ROOT / "runs" / "tables"
    """Where outcomes are kept."""
    out: Path | None = None
    """The page; default: docs/results.md. Pictures go to images/ beside it."""
    cell: str | None = None
    """Do this one cell here, in this process."""

    def workplace(self) -> Workplace:
        """Where these options put outcomes."""
        scale = MINIATURE if self.miniature else FULL
        folder = self.folder / scale.name if self.miniature else self.folder
        return Workplace(folder.resolve(), self.pandaset.resolve(), scale)

    def page_file(self) -> Path:
        """Where the page is written."""
        if self.out is not None:
            return self.out
        return self.workplace().folder / "results.md" if self.miniature else ROOT / "docs" / "results.md"


def main(options: Options) -> int:
    """Exit status: 0 where no cell failed."""
    place = options.workplace()
    if options.cell is not None:
        end_with_parent()
        if options.cell not in place.cells:
            raise OptionError(f"there is no cell {options.cell!r}; --list shows them all")
        work(place.cells[options.cell], place)
        return 0
    cells = choose_cells(tuple(place.cells.values()), options.only, options.full_length)
    if options.list:
        print(listing(cells, place))
        return 0
    if options.redo:
        forget(choose_exactly(place, options.redo), place)
    return make(options, cells, place)


def make(options: Options, cells: tuple[Cell, ...], place: Workplace) -> int:
    """Do cells, write the page, print the JSON line."""
    started = time.monotonic()
    say(f"{list_expected(cells, place) / 60:.0f} minutes of work expected on 2 cores")
    if commit().endswith("+"):
        say("tracked files differ from the commit: the page will mark it with +")
    queue = Queue(
        command=lambda cell: [*child_command(options), "--cell", cell.name],
        is_done=lambda cell: place.outcome_file(cell.name).is_file(),
        log_file=lambda cell: place.log_file(cell.name),
        say=say,
        jobs=options.jobs,
        budget=options.budget,
    )
    outcome = queue.run(cells)
    file = options.page_file()
    write_page(file, place)
    line = {
        "done": len(outcome.done),
        "left": len(outcome.left),
        "failed": outcome.failed,
        "seconds": round(time.monotonic() - started, 1),
        "page": str(file),
    }
    print(json.dumps(line))
    return 1 if outcome.failed else 0


def child_command(options: Options) -> list[str]:
    """What starts a process with the same workplace."""
    words = ["--folder", str(options.folder.resolve()), "--pandaset", str(options.pandaset.resolve())]
    return [sys.executable, "-m", "benchmarks.tables", *words, *(["--miniature"] if options.miniature else [])]


def choose_exactly(place: Workplace, patterns: tuple[str, ...]) -> tuple[Cell, ...]:
    """The cells that patterns name, without what they need."""
    free = tuple(replace(cell, needs=()) for cell in place.cells.values())
    return tuple(place.cells[cell.name] for cell in choose_cells(free, patterns))


def forget(cells: tuple[Cell, ...], place: Workplace) -> None:
    """Delete outcomes and scenes of cells."""
    for cell in cells:
        place.outcome_file(cell.name).unlink(missing_ok=True)
        if cell.kind in ("geometry", "method"):
            shutil.rmtree(place.own_run(cell.name), ignore_errors=True)


def list_expected(cells: tuple[Cell, ...], place: Workplace) -> float:
    """Seconds on 2 cores of what is not done yet."""
    return sum(cell.seconds for cell in cells if not place.outcome_file(cell.name).is_file())


def listing(cells: tuple[Cell, ...], place: Workplace) -> str:
    """A line for each cell, and the sum of what is left."""
    lines, left = [], 0
    for cell in cells:
        outcome = place.outcome(cell.name)
        left += outcome is None
        state = f"{outcome['seconds']:6.0f} s done" if outcome else f"{cell.seconds:6.0f} s expected"
        lines.append(f"{cell.name:48} {state}")
    lines.append(
        f"{left} of {len(cells)} cells left, {list_expected(cells, place) / 60:.0f} minutes expected on 2 cores"
    )
    return "\n".join(lines)


def write_page(file: Path, place: Workplace) -> None:
    """Write the page from all outcomes there are, with their pictures; notes written by hand are kept."""
    outcomes = {name: outcome for name in place.cells if (outcome := place.outcome(name)) is not None}
    images = {}
    for name in outcomes:
        if place.cells[name].kind == "figure":
            target = file.parent / "images" / f"results_{name.removeprefix('figure/').replace('/', '_')}.jpg"
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(place.image(name), target)
            images[name] = f"images/{target.name}"
    text = page(Results(outcomes, tuple(place.cells.values()), images, place.scale.name), read_notes(file))
    file.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(file, text.encode())


def read_notes(file: Path) -> str:
    """What stands between the markers of a page written before."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    if NOTES_START not in text or NOTES_END not in text:
        return ""
    return text.split(NOTES_START, 1)[1].split(NOTES_END, 1)[0].strip()


def say(text: str) -> None:
    """A line for people; standard output is for the JSON line."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(Options)))
    except InstDriveError as error:
        sys.exit(str(error))
