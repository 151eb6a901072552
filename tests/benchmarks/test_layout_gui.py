"""Nothing is cut off or covered: where widgets are in the real window, at several sizes and scales."""

import shutil
from itertools import combinations

import pytest

from benchmarks.tour import visit

pytestmark = [pytest.mark.gui, pytest.mark.slow]

SIZES = [((1280, 720), 1.0), ((1280, 720), 2.0), ((1600, 900), 1.0), ((1024, 640), 1.0), ((640, 400), 2.0)]
TINY = [1280, 800]
"""Pixels of the smallest window, whose text is twice as large."""
WHOLE_TOUR = (1024, 640)
MOST_TELLING = ("empty", "open", "one", "move tool", "side by side, depth", "hover", "dialog export", "dialog cleanup")
MOST_TELLING += ("dialog shortcuts", "dialog about", "menu Help", "camera path", "dialog film")
"""States that are looked at in the other windows; `benchmarks.tour` looks at all of them in many more."""
CONTAINERS = ("viewport", "picture", "reference", "hover label", "deletion review")
"""What other widgets stand in, or what follows the mouse over them."""
SLACK = 1.0
"""Pixels by which neighbours may overlap: halves that were rounded."""
ALWAYS_IN_VIEW = {
    "empty": ("empty.open", "empty.sample"),
    "open": ("view.depth", "tool.scale", "instances.search", "timeline.slider", "time.play", "view.beside"),
    "one": ("inspector.name", "edit.delete", "labels.absorb", "inspector.class", "inspector.color.black"),
    "dialog shortcuts": ("dialog.cancel",),
    "dialog export": ("dialog.path", "dialog.accept", "dialog.cancel"),
    "dialog about": ("about.copy", "dialog.cancel"),
    "dialog film": ("export.film.size", "export.film.rate", "dialog.accept"),
    "camera path": ("path.film", "path.strip", "path.strip.2"),
    "menu Help": ("menu help.log",),
}


@pytest.fixture(scope="module", params=SIZES, ids=lambda item: f"{item[0][0]}x{item[0][1]} at {item[1]:g}")
def tour(request, tmp_path_factory):
    """What the tour saw: size, marks and cut widgets of each state."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    (width, height), scale = request.param
    only = () if (width, height) == WHOLE_TOUR else MOST_TELLING
    states = visit(tmp_path_factory.mktemp("looks") / "tour", (width, height), scale, "dark", only)
    return {"pixels": [width * scale, height * scale], "states": states}


def test_the_window_and_its_text_are_as_large_as_asked(tour):
    for name, state in tour["states"].items():
        assert state["size"] == tour["pixels"], name


def test_every_widget_is_whole_and_inside_the_window(tour):
    width, height = tour["pixels"]
    for name, state in tour["states"].items():
        assert state["cut"] == [], name
        for mark, (left, top, right, bottom) in state["marks"].items():
            inside = left >= -SLACK and top >= -SLACK and right <= width + SLACK and bottom <= height + SLACK
            assert inside, f"{name}: {mark} at {left, top, right, bottom}"


def test_no_widget_is_on_top_of_another(tour):
    background = {}
    for name, state in tour["states"].items():
        marks = state["marks"]
        if tour["pixels"] == TINY:  # so small a window has no room for messages, nor for two pictures
            marks = {mark: place for mark, place in marks.items() if not mark.startswith("toast")}
            marks = {} if name.startswith("side by side") else marks
        if name.startswith("side by side"):  # half a picture has no room for messages, as in `benchmarks.tour`
            marks = {mark: place for mark, place in marks.items() if not mark.startswith("toast")}
        if name.startswith(("dialog", "menu")):  # what pops up covers what was there, which has its marks still
            behind = {mark for mark in marks if mark in background or mark.startswith("instances.")}
            marks = {mark: place for mark, place in marks.items() if mark not in behind}
        else:
            background = marks
        for first, second in combinations(sorted(marks), 2):
            if not _may_overlap(first, second):
                assert not _overlap(marks[first], marks[second]), f"{name}: {first} and {second}"


def test_what_is_needed_most_is_in_view(tour):
    if tour["pixels"] == TINY:
        pytest.skip("at 640 × 400 pixels of scale 1 panels have to be scrolled")
    for name, needed in ALWAYS_IN_VIEW.items():
        missing = [mark for mark in needed if mark not in tour["states"][name]["marks"]]
        assert missing == [], name


def _may_overlap(first, second):
    if first in CONTAINERS or second in CONTAINERS or "gizmo" in first + second:
        return True
    row = first.split(".")[0] == "instances" and first.split(".")[-1].isdigit()
    return second.startswith(f"{first}.") or (row and second == "instances.name")  # what stands in a row of the list


def _overlap(one, other):
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return width > SLACK and height > SLACK
