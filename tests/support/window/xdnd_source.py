"""Another program from whose window files are dragged: the source's side of XDND, over the X protocol.

Messages and their fields: the XDND specification, version 5 (https://freedesktop.org/wiki/Specifications/XDND).
"""

import time
from contextlib import contextmanager
from urllib.parse import quote

from Xlib import X, Xatom, display
from Xlib.protocol import event

VERSION = 5
PATIENCE = 60.0
"""Seconds to wait for an answer of the window, on a busy machine."""


def uri_of(path):
    """``file:///a/b%20c.ply``, as file managers write it; names that are no UTF-8 keep their bytes."""
    return "file://" + quote(bytes(path))


class DropSource:
    """A client of the display in DISPLAY that owns the dragged data. Answers are waited for, and None if none comes."""

    def __init__(self):
        self._display = display.Display()
        root = self._display.screen().root
        self._window = root.create_window(-10, -10, 1, 1, 0, X.CopyFromParent)
        self._atoms = {}

    def close(self):
        """Leave the display."""
        self._display.close()

    def drop(self, paths, at):
        """Drag files to a place of the screen and let go; returns whether the target took them."""
        return self.drop_data("".join(uri_of(path) + "\r\n" for path in paths).encode(), at)

    def drop_data(self, data, at, kind="text/uri-list"):
        """Drag bytes of a type and let go; returns whether the target took them, False where it declined before."""
        target = self._target_under(at)
        if not self._drag_over(target, at, kind):
            self._send(target, "XdndLeave")
            return False
        self._send(target, "XdndDrop", 0, X.CurrentTime)
        finished = self._answer("XdndFinished", lambda request: self._hand_over(request, kind, data))
        return finished[1] != 0  # bit 0 should say it; GLFW puts the length of what it got there

    def drag_past(self, at):
        """Drag a file over the target and away again."""
        target = self._target_under(at)
        accepted = self._drag_over(target, at, "text/uri-list")
        self._send(target, "XdndLeave")
        return accepted

    # ---------------------------------------------------------------- protocol

    def _drag_over(self, target, at, kind):
        """Enter the window and point at a place; returns whether it would take the data there."""
        self._window.set_selection_owner(self._atom("XdndSelection"), X.CurrentTime)
        self._send(target, "XdndEnter", VERSION << 24, self._atom(kind))
        action = self._atom("XdndActionCopy")
        self._send(target, "XdndPosition", 0, round(at[0]) << 16 | round(at[1]), X.CurrentTime, action)
        return bool(self._answer("XdndStatus")[1] & 1)

    def _target_under(self, at):
        """The topmost window there that says it takes part."""
        aware = self._atom("XdndAware")
        for window in reversed(self._display.screen().root.query_tree().children):
            place = window.get_geometry()
            inside = 0 <= at[0] - place.x < place.width and 0 <= at[1] - place.y < place.height
            version = window.get_full_property(aware, Xatom.ATOM)
            if inside and version is not None:
                return window
        raise AssertionError(f"no window at {at} takes part in drag and drop")

    def _hand_over(self, request, kind, data):
        """Write the data where the target wants it, and say so."""
        if request.target != self._atom(kind):
            return
        request.requestor.change_property(request.property, request.target, 8, data)
        told = {name: getattr(request, name) for name in ("time", "requestor", "selection", "target", "property")}
        request.requestor.send_event(event.SelectionNotify(**told))
        self._display.flush()

    def _send(self, target, name, *values):
        words = (32, [self._window.id, *values, *[0] * (4 - len(values))])
        target.send_event(event.ClientMessage(window=target, client_type=self._atom(name), data=words))
        self._display.flush()

    def _answer(self, name, give=lambda request: None):
        """The five words of the target's next message of that name; requests for the data go to `give` meanwhile."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if not self._display.pending_events():
                time.sleep(0.01)
                continue
            came = self._display.next_event()
            if came.type == X.SelectionRequest:
                give(came)
            elif came.type == X.ClientMessage and came.client_type == self._atom(name):
                return came.data[1]
        raise AssertionError(f"the window did not answer with {name} in {PATIENCE:.0f} s")

    def _atom(self, name):
        if name not in self._atoms:
            self._atoms[name] = self._display.intern_atom(name)
        return self._atoms[name]


@contextmanager
def drop_source():
    """A source on the present display, until the block ends."""
    source = DropSource()
    try:
        yield source
    finally:
        source.close()
