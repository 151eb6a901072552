"""Modal dialogs, one file each.

A command opens one by setting `session.dialog` to one of its names. A new dialog is a file and a line in
`panels/registry.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from instdrive_app.panels.widgets.ui import Ui


class Dialog(Protocol):
    """A popup that asks for something."""

    names: tuple[str, ...]
    """What `session.dialog` is set to in order to open it."""

    def ask(self, ui: Ui, name: str) -> None:
        """Open it; `name` says for which of its purposes."""

    def draw(self, ui: Ui) -> None:
        """One frame, whether it is open or not."""


class DialogHost:
    """Opens whichever dialog the session asks for, and draws the open one."""

    def __init__(self, dialogs: Sequence[Dialog]) -> None:
        self._dialogs = tuple(dialogs)
        self._by_name = {name: dialog for dialog in dialogs for name in dialog.names}

    @property
    def names(self) -> frozenset[str]:
        """What `session.dialog` can be."""
        return frozenset(self._by_name)

    def draw(self, ui: Ui) -> None:
        """One frame. Raises KeyError for a name that no dialog has."""
        asked, ui.session.dialog = ui.session.dialog, None
        if asked is not None:
            self._by_name[asked].ask(ui, asked)
        for dialog in self._dialogs:
            dialog.draw(ui)
