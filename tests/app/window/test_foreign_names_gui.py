"""Names in scripts that the editor's own font lacks: shown where the system has a font, told where it has none."""

from dataclasses import replace

import pytest
from procedural_street import FIRST_CAR, procedural_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def street_in_chinese(tmp_path):
    scene = procedural_street()
    scene.table.set(replace(scene.table[FIRST_CAR], name="红色汽车"))
    save_scene(tmp_path / "street", scene)
    return tmp_path / "street"


def test_letters_that_no_font_has_are_told(street_in_chinese, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_DIRS", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    with editor_window(street_in_chinese, tmp_path) as window:
        window.wait_for_message("No font of this computer has 4 characters of the names")
        assert window.quit() == 0
