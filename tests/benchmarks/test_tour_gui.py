"""A short tour of the smallest window in the light theme: no widget is cut off, outside, or on top of another one."""

import json
import shutil

import pytest

from benchmarks.tour import find_faults, find_untranslated, visit

pytestmark = pytest.mark.gui

SHORT = ("open", "one", "first steps", "dialog preferences", "dialog export", "dialog shortcuts", "hover", "menu Edit")
SHORT += ("tool brush", "tool box", "panel Filter", "panel Views", "panel Training", "panel Runs", "panel Camera path")


GERMAN = ("open", "one", "dialog preferences", "dialog export", "dialog shortcuts", "menu Edit")
"""States with the longest words."""


@pytest.mark.parametrize(("language", "visited"), [("en", SHORT), ("de", GERMAN)])
def test_nothing_is_cut_off_or_covered(tmp_path, language, visited):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    states = visit(tmp_path / "tour", (900, 600), 1.0, "light", visited, language=language)
    assert set(states) == set(visited)
    assert language == "de" or "first_steps" in states["first steps"]["marks"]
    assert "preferences.theme.light" in states["dialog preferences"]["marks"]
    assert find_faults(states) == []
    texts = json.loads((tmp_path / "tour/texts.json").read_text(encoding="utf-8"))
    assert ("Bearbeiten" if language == "de" else "Edit") in texts
    assert language == "en" or find_untranslated(texts, language) == []


def test_english_words_are_found():
    assert find_untranslated(["Bearbeiten", "Edit", "Log", "Car 17", "Open"], "de") == [
        "'Edit' is drawn in English",
        "'Log' is drawn in English",
        "'Open' is drawn in English",
    ]


def test_faults_are_found():
    marks = {"a": [0, 0, 50, 50], "b": [40, 40, 90, 120], "a.inside": [0, 0, 9, 9]}
    assert find_faults({"open": {"size": [100, 100], "cut": ["name"], "marks": marks}}) == [
        "open: name is cut off",
        "open: b is outside the window",
        "open: a and b overlap",
    ]
