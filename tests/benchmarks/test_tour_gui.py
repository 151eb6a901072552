"""A short tour of the smallest window in the light theme: no widget is cut off, outside, or on top of another one."""

import shutil

import pytest

from benchmarks.tour import find_faults, visit

pytestmark = pytest.mark.gui

SHORT = ("open", "one", "first steps", "dialog preferences", "dialog export", "dialog shortcuts", "hover", "menu Edit")
SHORT += ("tool brush", "tool box", "panel Filter", "panel Views", "panel Training", "panel Runs", "panel Camera path")


def test_nothing_is_cut_off_or_covered(tmp_path):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    states = visit(tmp_path / "tour", (900, 600), 1.0, "light", SHORT)
    assert set(states) == set(SHORT)
    assert "first_steps" in states["first steps"]["marks"]
    assert "preferences.theme.light" in states["dialog preferences"]["marks"]
    assert find_faults(states) == []


def test_faults_are_found():
    marks = {"a": [0, 0, 50, 50], "b": [40, 40, 90, 120], "a.inside": [0, 0, 9, 9]}
    assert find_faults({"open": {"size": [100, 100], "cut": ["name"], "marks": marks}}) == [
        "open: name is cut off",
        "open: b is outside the window",
        "open: a and b overlap",
    ]
