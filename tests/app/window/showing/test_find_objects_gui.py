"""A scene without instances: *Find objects* makes some, and one of them is clicked and deleted."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import procedural_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene
from instdrive_core.instances.table import InstanceTable

pytestmark = pytest.mark.gui


def test_objects_are_found_and_one_is_deleted(tmp_path):
    scene = procedural_street(0.3)
    zeros = np.zeros(len(scene), np.uint32)
    save_scene(tmp_path / "bare", replace(scene, instance_ids=zeros, codewords=zeros.copy(), table=InstanceTable()))
    with editor_window(tmp_path / "bare", tmp_path) as window:
        window.click_widget("menu Labels")
        window.click_widget("menu labels.find_objects")
        window.click_widget("find.alone")
        window.click_widget("dialog.accept")
        window.wait_for_edit("Find objects")
        state = window.wait_for(lambda state: "found; click them" in state["messages"][-1], "what was found")
        assert len(state["visible"]) >= 5
        first = state["visible"][0]
        window.click_widget(f"instances.{first}")
        window.wait_for_selection(first)
        window.key("Delete")
        window.wait_for_edit("Delete")
        window.key("ctrl+z")
        window.key("ctrl+z")
        window.key("ctrl+z")
        window.wait_for(lambda state: state["visible"] == [], "no instance after undo")
        assert window.quit() == 0
