"""What the session asks the window to do once: typed values in one queue.

A new request is a class here and whatever answers it: usually a dialog, which `panels/dialogs/registry.py` lists.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, TypeVar

from instdrive_app.session.export_kinds import What
from instdrive_core.errors import SceneTooLargeError

PathPurpose = Literal["open", "insert", "save", "export_keys", "import_keys", "read_way"]


def do_nothing() -> None:
    """Continuation where nothing is to follow."""


@dataclass(frozen=True)
class Request:
    """One thing to do for the user, as soon as no dialog is open."""

    is_urgent: ClassVar[bool] = False
    """Whether it is answered even while a dialog is open."""
    patience: ClassVar[int] = 0
    """Frames in which a panel may take the request before a dialog opens for it."""


@dataclass(frozen=True)
class ShowPanel(Request):
    """Bring a docked panel to the front."""

    is_urgent: ClassVar[bool] = True
    panel: str
    """The name on its tab."""
    closes: bool = False
    """Whether it is closed instead."""


@dataclass(frozen=True)
class ReceiveDrop(Request):
    """Open or insert files that were dropped onto the window."""

    is_urgent: ClassVar[bool] = True
    paths: tuple[Path, ...]


@dataclass(frozen=True)
class AskPath(Request):
    """Ask for the path of a scene or project, and open, insert or save it."""

    purpose: PathPurpose
    then: Callable[[], None] = do_nothing
    """What follows a save."""


@dataclass(frozen=True)
class AskExport(Request):
    """Ask what to export, in which format and where to."""

    what: What = "scene"
    """The choice the dialog begins with."""


@dataclass(frozen=True)
class AskRecord(Request):
    """Ask how the drive is to be recorded as sensor data, and where to."""


@dataclass(frozen=True)
class AskName(Request):
    """Let the user rename an instance: in the list where it is on screen, else in a dialog."""

    patience: ClassVar[int] = 2
    instance: int


@dataclass(frozen=True)
class AskClass(Request):
    """Ask for the class of some instances."""

    ids: tuple[int, ...]


@dataclass(frozen=True)
class AskSplit(Request):
    """Ask how to split an instance."""

    instance: int


@dataclass(frozen=True)
class AskReassign(Request):
    """Ask which instance gets the selected splats."""


@dataclass(frozen=True)
class AskUp(Request):
    """Ask which way is up in the scene."""


@dataclass(frozen=True)
class AskUnsaved(Request):
    """Ask whether to save before something closes the document."""

    then: Callable[[], None]
    """What closes it."""


@dataclass(frozen=True)
class AskChangedScene(Request):
    """Ask whether to open a document although its scene is no longer the one that was edited."""

    reason: str
    """What the user reads about the change."""
    open_anyway: Callable[[], None]
    """Opens the document without the edits that no longer fit."""


@dataclass(frozen=True)
class AskOtherSave(Request):
    """Ask whether to overwrite a project that another editor has saved since it was opened or saved here."""

    path: Path
    save_over: Callable[[], None]


@dataclass(frozen=True)
class AskTooLarge(Request):
    """Ask whether to open part of a scene that does not fit into memory."""

    path: Path
    error: SceneTooLargeError


@dataclass(frozen=True)
class AskNewScene(Request):
    """Ask what a new scene is to be made of, and for how long."""

    source: Path | None = None
    """What was dropped; None = the user chooses."""


@dataclass(frozen=True)
class AskImprove(Request):
    """Ask how long the open scene is to train on, and into which folder."""


@dataclass(frozen=True)
class AskFindObjects(Request):
    """Ask what the scene's objects are found by."""


@dataclass(frozen=True)
class AskLeaveJob(Request):
    """Ask what becomes of the job that runs when the editor closes."""

    then: Callable[[], None]
    """What closes it."""


@dataclass(frozen=True)
class OfferJob(Request):
    """Offer to go on with a job that was stopped, or whose process has ended."""

    run: Path


@dataclass(frozen=True)
class OfferRecovery(Request):
    """Offer the work of editors that ended without saving."""


@dataclass(frozen=True)
class OfferCleanup(Request):
    """Offer to remove the defective splats of the scene."""


@dataclass(frozen=True)
class ShowPalette(Request):
    """Open the command palette."""


@dataclass(frozen=True)
class ShowShortcuts(Request):
    """Open the sheet of keys and mouse gestures."""


@dataclass(frozen=True)
class AskPreferences(Request):
    """Let the user choose how the editor looks and answers."""


@dataclass(frozen=True)
class ShowAbout(Request):
    """Open the dialog with version and log file."""


Wanted = TypeVar("Wanted", bound=Request)


class RequestQueue:
    """Requests that nothing has answered yet, oldest first. Used on the UI's thread only."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Request, int]] = []
        """Each with the number of frames it has waited."""

    @property
    def waiting(self) -> tuple[Request, ...]:
        """The requests, oldest first."""
        return tuple(request for request, _ in self._waiting)

    def put(self, request: Request) -> None:
        """Add a request."""
        self._waiting.append((request, 0))

    def take(self, kind: type[Wanted]) -> Wanted | None:
        """Remove and return the oldest request of a kind; None where there is none."""
        for number, (request, _) in enumerate(self._waiting):
            if isinstance(request, kind):
                del self._waiting[number]
                return request
        return None

    def take_due(self, is_blocked: bool) -> Request | None:
        """Remove and return the oldest request that is due; None where none is. Call it once a frame.

        `is_blocked`: a dialog is open, so that only urgent requests are due.
        """
        self._waiting = [(request, frames + 1) for request, frames in self._waiting]
        for number, (request, frames) in enumerate(self._waiting):
            if frames > request.patience and (request.is_urgent or not is_blocked):
                del self._waiting[number]
                return request
        return None
