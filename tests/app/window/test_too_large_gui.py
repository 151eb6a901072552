"""A scene that does not fit into memory: the real window asks, and opens the part that does."""

import pytest
from procedural_street import procedural_street
from window_driver import editor_window

from instdrive_core.available_memory import VARIABLE
from instdrive_core.formats.allocation import MEMORY_TO_EDIT, count_row_bytes
from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


def test_it_asks_and_opens_every_third_splat(tmp_path, monkeypatch):
    scene = procedural_street()
    save_scene(tmp_path / "street", scene)
    needed = (
        MEMORY_TO_EDIT
        * len(scene)
        * count_row_bytes(scene.gaussians.sh_rest.shape[1], scene.gaussians.features.shape[1])
    )
    monkeypatch.setenv(VARIABLE, str(0.4 * needed / 1e9))
    with editor_window(tmp_path / "street", tmp_path, opens=False) as window:
        window.click_widget("question.Open every 3rd")
        state = window.wait_until_open()
        assert any(text.startswith("Every 3rd splat was opened") for text in state["messages"])
        assert window.quit() == 0
