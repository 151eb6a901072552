"""Modal dialogs, one file each.

A dialog opens when the session's queue holds a request that it answers. A new dialog is a request in
`session/requests.py`, a file here, and a line in `registry`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from imgui_bundle import imgui

from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.requests import Request

_log = logging.getLogger(__name__)


@runtime_checkable
class Dialog(Protocol):
    """A popup that asks for something."""

    def open(self, ui: Ui, request: Any) -> None:
        """Open it for a request of one of the types that its record answers."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame, whether it is open or not."""


@dataclass(frozen=True)
class DialogRecord:
    """One dialog of the window."""

    title: str
    icon: str
    """Name of an icon constant of Font Awesome 6."""
    create: Callable[[], Dialog]
    answers: tuple[type[Request], ...]
    """Types of the requests that open the dialog; no other dialog answers them."""


HELD_FRAMES = 4
"""Frames until a panel has come to the front."""


class DialogHost:
    """Opens the dialog for each request, one at a time, and draws the open one."""

    def __init__(self, records: Sequence[DialogRecord]) -> None:
        """Create the dialogs. Raises ValueError if two of them answer the same request."""
        self._held = 0
        self._dialogs: list[Dialog] = []
        self._by_request: dict[type[Request], Dialog] = {}
        for record in records:
            dialog = record.create()
            self._dialogs.append(dialog)
            for kind in record.answers:
                if kind in self._by_request:
                    raise ValueError(f"two dialogs answer {kind.__name__}")
                self._by_request[kind] = dialog

    @property
    def answers(self) -> frozenset[type[Request]]:
        """Types of the requests that open a dialog."""
        return frozenset(self._by_request)

    def draw(self, ui: Ui) -> None:
        """Draw one frame: open the dialog for the next request, unless one is open, and draw all dialogs."""
        is_blocked = self._held > 0 or imgui.internal.get_top_most_popup_modal() is not None
        self._held = max(self._held - 1, 0)
        request = ui.session.requests.take_due(is_blocked)
        if request is not None:
            self.open(ui, request)
        for dialog in self._dialogs:
            dialog.draw(ui)

    def hold(self) -> None:
        """Open no dialog in the next frames: a panel comes to the front, and would close it."""
        self._held = HELD_FRAMES

    def open(self, ui: Ui, request: Request) -> None:
        """Open the dialog for a request; one that no dialog answers is logged as an error."""
        dialog = self._by_request.get(type(request))
        if dialog is None:
            _log.error("nothing answers the request %r", request)
        else:
            dialog.open(ui, request)
