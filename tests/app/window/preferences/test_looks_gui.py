"""Themes and instance colours, chosen in Preferences of the real window with true mouse and keys."""

import json

import numpy as np
import pytest
from PIL import ImageGrab
from window_driver import editor_window

from instdrive_app.preferences.instance_colors import SAFE_COLORS, paint_safe_colors
from instdrive_app.preferences.themes import THEMES

pytestmark = pytest.mark.gui


def grab(out, name):
    """The whole display, as the user sees it."""
    picture = ImageGrab.grab()
    picture.save(out / f"{name}.png")
    return np.asarray(picture.convert("RGB"))


def choose_theme(window, name):
    window.key("ctrl+comma")
    window.click_widget(f"preferences.theme.{name}")
    window.wait_for(lambda state: state["preferences"]["theme"] == name, f"the theme {name}")


@pytest.mark.slow
def test_themes_are_shown_at_once_and_kept(street_folder, tmp_path):
    with editor_window(street_folder, tmp_path) as window:
        for name in ("light", "high contrast", "dark", "light"):
            choose_theme(window, name)
            window.wait_for_widget("dialog.cancel")
            window.key("Escape")
            window.wait_for(lambda state: "dialog.cancel" not in state["widgets"], "the dialog to close")
            window.move(5, 400)
            window.wait_until_calm()
            seen = grab(tmp_path, name).reshape(-1, 3)
            panel = np.rint(np.array(THEMES[name].panel) * 255)
            assert np.mean(np.abs(seen - panel).max(axis=1) <= 2) > 0.1, name
        assert window.quit() == 0
    assert json.loads((tmp_path / "state/preferences.json").read_text())["theme"] == "light"
    (tmp_path / "again").mkdir()
    (tmp_path / "state").rename(tmp_path / "again/state")
    with editor_window(street_folder, tmp_path / "again") as window:
        assert window.state["preferences"]["theme"] == "light"


def test_safe_colors_are_shown_and_a_click_picks_what_it_picked(street_folder, tmp_path):
    with editor_window(street_folder, tmp_path) as window:
        window.key("2")
        window.wait_for(lambda state: state["view_mode"] == "INSTANCE", "the ID view")
        left, top, right, bottom = window.state["widgets"]["picture"]
        places = [(left + (right - left) * x, top + (bottom - top) * y) for x in (0.3, 0.5, 0.7) for y in (0.5, 0.6)]

        def find_picked():
            found = []
            for place in places:
                window.move(*place)
                window.wait_until_calm()
                found.append(window.state["hovered"])
            return found

        before = find_picked()
        assert any(before)
        window.key("ctrl+comma")
        window.click_widget("preferences.safe_colors")
        window.wait_for(lambda state: state["preferences"]["safe_colors"], "safe colours")
        window.key("Escape")
        assert find_picked() == before
        window.move(5, 400)
        window.wait_until_calm()
        seen = grab(tmp_path, "safe colours")
        for (x, y), instance in zip(places, before, strict=True):
            shown = seen[int(y), int(x)]
            if instance:
                assert np.abs(shown - paint_safe_colors(np.array(instance, np.uint32)).astype(int)).max() <= 3
        assert len(SAFE_COLORS) == 12
