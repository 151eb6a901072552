"""The filter panel in the real window: its key, its sliders, the preview of floaters, undo."""

import pytest

pytestmark = pytest.mark.gui


def test_sliders_select_a_range_and_delete_removes_it(window):
    window.key("ctrl+f")
    left, top, right, bottom = window.wait_for_rect("filter.from")
    window.drag((left + 8, (top + bottom) / 2), ((left + right) / 2, (top + bottom) / 2))
    state = window.wait_for(lambda state: state["selected_splats"] > 0, "the slider to select")
    assert state["cursor"] == 1, "one drag is one step"
    window.click_widget("filter.value")
    window.click_widget("filter.value.hue")
    left, top, right, bottom = window.wait_for_rect("filter.to")
    window.drag((right - 8, (top + bottom) / 2), ((left + right) / 2, (top + bottom) / 2))
    state = window.wait_for(lambda state: state["cursor"] == 2, "another value to be another step")
    window.key("Delete")
    window.wait_for_edit("Delete selection")
    window.key("ctrl+z")
    window.wait_for(lambda now: now["selected_splats"] == state["selected_splats"], "undo")
    window.key("ctrl+p")
    window.type("needle")
    window.tap("Return")
    window.wait_for(lambda state: any("loaters" in text for text in state["messages"]), "the palette to find floaters")
    assert window.quit() == 0
