"""Another program that has copied a text: the owner's side of the clipboard, over the X protocol (ICCCM, section 2)."""

from contextlib import contextmanager
from threading import Event, Thread

from Xlib import X, display
from Xlib.protocol import event


@contextmanager
def copied(text):
    """The present display's clipboard holds a text until the block ends; yields the event that it was pasted."""
    owner = display.Display()
    window = owner.screen().root.create_window(-10, -10, 1, 1, 0, X.CopyFromParent)
    window.set_selection_owner(owner.intern_atom("CLIPBOARD"), X.CurrentTime)
    owner.sync()
    pasted, finished = Event(), Event()
    answering = Thread(target=_answer, args=(owner, text.encode(), pasted, finished), daemon=True)
    answering.start()
    try:
        yield pasted
    finally:
        finished.set()
        answering.join()
        owner.close()


def _answer(owner, data, pasted, finished):
    """Hand the text to whoever asks for it as UTF-8, and nothing to others."""
    utf8 = owner.intern_atom("UTF8_STRING")
    while not finished.wait(0.002):
        if not owner.pending_events():
            continue
        request = owner.next_event()
        if request.type != X.SelectionRequest:
            continue
        told = {name: getattr(request, name) for name in ("time", "requestor", "selection", "target", "property")}
        if request.target == utf8:
            request.requestor.change_property(request.property, utf8, 8, data)
        else:
            told["property"] = X.NONE
        request.requestor.send_event(event.SelectionNotify(**told))
        owner.flush()
        if request.target == utf8:
            pasted.set()
