"""What finished cells left, and figures out of it; what is missing is None and shows as –."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, stdev
from typing import Any

from benchmarks.cells import Cell, method_name

PUBLISHED, SPLIT = "as published", "split"
"""The rows of a method: with nothing added, and with the actor nodes and spatial components of ours."""

Figures = Mapping[str, Any]


@dataclass(frozen=True)
class Results:
    """Everything that a page is written from."""

    outcomes: Mapping[str, Mapping[str, Any]]
    """By name of the cell."""
    cells: Sequence[Cell]
    """All that there could be."""
    images: Mapping[str, str]
    """Pictures by name of the figure's cell, relative to the page."""
    scale: str = "full"

    def figures(self, clip: str, cameras: str, masks: str, method: str, variant: str = "", row: str = SPLIT) -> Figures:
        """The evaluation's figures of a method's row; empty where they are not there."""
        outcome = self.outcomes.get(method_name(clip, cameras, masks, method, variant), {})
        return outcome.get("rows", {}).get(row, {})


def value(figures: Figures, path: str) -> Any:
    """A figure by its dotted key, e.g. ``scene.miou``; None where there is none."""
    found: Any = figures
    for key in path.split("."):
        found = found.get(key) if isinstance(found, Mapping) else None
    return found


def ratio(part: float | None, whole: float | None) -> float | None:
    """part / whole; None where either is missing or the whole is 0."""
    return part / whole if part is not None and whole else None


def difference(left: float | None, right: float | None) -> float | None:
    """left - right; None where either is missing."""
    return left - right if left is not None and right is not None else None


def format_value(number: float | str | None, digits: int = 3) -> str:
    """A number for readers."""
    if number is None:
        return "–"
    if isinstance(number, str):
        return number
    return f"{number:,}" if isinstance(number, int) else f"{number:.{digits}f}"


def format_spread(numbers: Sequence[float | None], digits: int = 3) -> str:
    """Mean ± sample standard deviation of the numbers there are; says how many where some are missing."""
    known = [number for number in numbers if number is not None]
    if not known:
        return "–"
    text = format_value(float(mean(known)), digits)
    if len(known) > 1:
        text += f" ± {stdev(known):.{digits}f}"
    return text if len(known) == len(numbers) else f"{text} ({len(known)} of {len(numbers)})"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; all columns but the first are aligned to the right."""
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines)
