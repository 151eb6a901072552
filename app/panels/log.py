"""The log of all messages to the user, newest last."""

from __future__ import annotations

import time

from imgui_bundle import imgui

from instdrive_app.language.translation import translate
from instdrive_app.messages import Level
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text
from instdrive_app.preferences.themes import ERROR


class LogPanel:
    """Lists messages with their time of day, and scrolls to new ones."""

    def __init__(self) -> None:
        self._seen = 0

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        log = ui.session.messages.log
        for message in log:
            draw_dim_text(time.strftime("%H:%M:%S", time.localtime(message.when)))
            imgui.same_line()
            if message.level is Level.ERROR:
                imgui.push_style_color(imgui.Col_.text, rgba(ERROR))
            imgui.text_wrapped(translate(message.text))
            if message.level is Level.ERROR:
                imgui.pop_style_color()
        if log and id(log[-1]) != self._seen:
            imgui.set_scroll_here_y(1.0)
            self._seen = id(log[-1])
