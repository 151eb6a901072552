"""A tour of the real window: every panel, dialog, menu, tool and view, at several sizes, scales, themes and languages.

`python -m benchmarks.tour OUT` visits them all on virtual displays, writes where each widget was and a picture of each
state into OUT, and prints one JSON line: what was visited, and every widget that was cut off, outside the window, or on
top of another one, or drawn in English although the window speaks another language. Exits 1 where there was any.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import Positional

from benchmarks.catalogue import read_catalogue
from benchmarks.sample_photos import add_photos
from instdrive_app.files.sample import find_sample_scene
from instdrive_app.language.languages import ENGLISH

ROOT = Path(__file__).parents[1]
TOUR = ROOT / "tests/support/window/look_tour.py"
VISITS = (((900, 600), 1.0), ((900, 600), 2.0), ((2560, 1440), 1.0), ((1280, 720), 2.0))
"""Sizes at scale 1 and scales: 900 × 600 and 2560 × 1440 pixels, and the same with text twice as large."""
CONTAINERS = ("viewport", "picture", "reference", "hover label", "deletion review")
"""What other widgets stand in, or what follows the mouse over them."""
SLACK = 1.0
"""Pixels by which neighbours may overlap: halves that were rounded."""
SECONDS = 1500
Rect = tuple[float, float, float, float]


@dataclass(frozen=True)
class Options:
    """Where to write, and what to visit."""

    out: Positional[Path]
    themes: tuple[str, ...] = ("dark", "light")
    languages: tuple[str, ...] = ("en", "de")
    pictures: bool = True
    only: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """States to visit; default: all."""


def visit(
    out: Path,
    size: tuple[int, int],
    scale: float,
    theme: str,
    only: tuple[str, ...] = (),
    pictures: bool = False,
    language: str = "en",
) -> dict[str, Any]:
    """Go on the tour in one window; returns size, marks and cut widgets of each state.

    Raises RuntimeError with what the window wrote where it failed.
    """
    command = [sys.executable, str(TOUR), str(out), "--size", *map(str, size), "--scale", str(scale), "--theme", theme]
    command += ["--language", language, *(["--pictures"] if pictures else [])]
    command += [word for state in only for word in ("--only", state)]
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "street"
        shutil.copytree(find_sample_scene(), scene)
        add_photos(scene, 1)
        command += ["--scene", str(scene)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads((out / "looks.json").read_text(encoding="utf-8"))


def find_untranslated(texts: Iterable[str], language: str) -> list[str]:
    """Find what was drawn in English although the language has words of its own for it, in a sentence each."""
    foreign = read_catalogue(language)
    said = {strip_text(text) for message in foreign for text in _list_forms(message.string)}
    english = {strip_text(text) for message in foreign for text in _list_forms(message.id)}
    return [f"{text!r} is drawn in English" for text in sorted({*texts} & (english - said - {""}))]


def strip_text(text: str) -> str:
    """The words without the dots at the end."""
    return text.rstrip(" …")


def _list_forms(text: str | Sequence[str] | None) -> Sequence[str]:
    return (text,) if isinstance(text, str) else text or ()


def find_faults(states: Mapping[str, Any]) -> list[str]:
    """Find widgets that are cut off, outside the window, or on top of one another, in a sentence each."""
    faults: list[str] = []
    behind: set[str] = set()
    for name, state in states.items():
        marks, (width, height) = state["marks"], state["size"]
        faults += [f"{name}: {mark} is cut off" for mark in state["cut"]]
        for mark, (left, top, right, bottom) in marks.items():
            if left < -SLACK or top < -SLACK or right > width + SLACK or bottom > height + SLACK:
                faults.append(f"{name}: {mark} is outside the window")
        if name.startswith(("dialog", "menu")):  # what pops up covers what was there, which has its marks still
            shown = {mark for mark in marks if mark not in behind and not mark.startswith("instances.")}
        else:
            behind = shown = set(marks)
        if name.startswith("side by side"):  # half a picture has no room for messages
            shown = {mark for mark in shown if not mark.startswith("toast")}
        for one, other in combinations(sorted(shown), 2):
            if not _may_overlap(one, other) and _overlap(marks[one], marks[other]):
                faults.append(f"{name}: {one} and {other} overlap")
    return faults


def _may_overlap(first: str, second: str) -> bool:
    if first in CONTAINERS or second in CONTAINERS or "gizmo" in first + second:
        return True
    row = first.split(".")[0] == "instances" and first.split(".")[-1].isdigit()
    return second.startswith(f"{first}.") or (row and second == "instances.name")


def _overlap(one: Rect, other: Rect) -> bool:
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return width > SLACK and height > SLACK


def main(options: Options) -> None:
    """Visit everything and print what is wrong."""
    faults, visited = [], 0
    for size, scale in VISITS:
        for theme, language in product(options.themes, options.languages):
            name = f"{size[0]}x{size[1]} at {scale:g}, {theme}, {language}"
            states = visit(options.out / name, size, scale, theme, options.only, options.pictures, language)
            visited += len(states)
            faults += [f"{name}: {fault}" for fault in find_faults(states)]
            if language != ENGLISH:
                texts = json.loads((options.out / name / "texts.json").read_text(encoding="utf-8"))
                faults += [f"{name}: {fault}" for fault in find_untranslated(texts, language)]
    print(json.dumps({"benchmark": "tour", "states": visited, "faults": faults}))
    if faults:
        raise SystemExit(1)


if __name__ == "__main__":
    main(tyro.cli(Options))
