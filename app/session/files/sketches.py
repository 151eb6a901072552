"""What a large scene looks like while it is still being opened: a sparse sketch, in which the user can look around."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from instdrive_app.jobs import Job
from instdrive_app.session.navigation import Navigation
from instdrive_core.edits.document.document import Document


@dataclass
class OpeningScene:
    """A scene that is being opened."""

    path: Path
    job: Job | None = None
    """None until it is handed to the jobs."""


@dataclass(frozen=True)
class Sketch:
    """Some splats of all over a scene whose opening still runs."""

    document: Document
    """Never edited; not the open document."""
    job: Job
    """The opening."""


class Sketches:
    """Shows the sketch of the scene that is being opened, from where the whole will be shown, until its job is over.

    All methods but `offer` run on the UI's thread.
    """

    def __init__(self, navigation: Navigation) -> None:
        self._navigation = navigation
        self._offered: SimpleQueue[tuple[OpeningScene, Document]] = SimpleQueue()
        self.shown: Sketch | None = None
        """What stands in for the open document; edits and clicks wait meanwhile."""

    def offer(self, opening: OpeningScene, document: Document) -> None:
        """Hand over a sketch; can be called from any thread."""
        self._offered.put((opening, document))

    def tick(self) -> None:
        """Show what has arrived, and leave a sketch whose opening is over; called once a frame, after the jobs.

        Where the scene could not be opened the user looks at what was open before, as before.
        """
        while not self._offered.empty():
            opening, document = self._offered.get()
            if opening.job is not None and not opening.job.over:
                self.shown = Sketch(document, opening.job)
                self._navigation.begin_sketch(document)
        if self.shown is not None and self.shown.job.over:
            self.shown = None
            self._navigation.leave_sketch()
