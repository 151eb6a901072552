"""Opening and exporting, in the background."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_core.edits.bake import baked
from instdrive_core.edits.document import Document
from instdrive_core.formats.registry import open_scene, save_scene


class Files:
    """What is on the disk of the open document."""

    def __init__(self, jobs: Jobs, messages: Messages, show: Callable[[Document, Path], None]) -> None:
        """`show` gets each document that was opened."""
        self._jobs, self._messages, self._show = jobs, messages, show
        self.path: Path | None = None
        """Where the open document came from."""
        self.last_export: Path | None = None

    def open(self, path: Path) -> None:
        """Open a scene."""
        self._jobs.submit(f"Opening {path.name}", lambda: _opened(path), lambda document: self._show(document, path))

    def export(self, document: Document, path: Path, time: float) -> None:
        """Write the edited scene: a file holds the moment `time` (seconds), a folder keeps the tracks."""
        moment = time if path.suffix else None

        def work() -> tuple[Path, int]:
            scene = baked(document, moment)
            save_scene(path, scene)
            return path, len(scene)

        self._jobs.submit(f"Exporting {path.name}", work, self._exported)

    def _exported(self, result: tuple[Path, int]) -> None:
        self.last_export, count = result
        self._messages.info(f"Exported {count:,} splats to {self.last_export}")


def _opened(path: Path) -> Document:
    document = Document(open_scene(path))
    document.open_scene = open_scene
    document.counts()  # builds the index of instances here, so that the first click finds it built
    return document
