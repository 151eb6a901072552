"""Exporting from the editor: the choice in the dialog, and writing it in the background."""

from __future__ import annotations

import os.path
from pathlib import Path

from instdrive_app.files.file_names import find_folder_beside
from instdrive_app.session.context import SessionContext
from instdrive_app.session.export_kinds import KINDS, ExportChoice, ExportKind, ExportRequest, What
from instdrive_app.session.files.document_files import DocumentFiles
from instdrive_core.project.export import make_file_name
from instdrive_core.project.sources import is_source
from instdrive_core.wording import format_count, phrase


class ExportController:
    """Holds the choice of the export dialog, and writes exports."""

    def __init__(self, context: SessionContext, files: DocumentFiles) -> None:
        self._context, self._files = context, files
        self.choice = ExportChoice()
        self.amounts: dict[What, str] = {}
        """How much there is of each kind, for the user; empty where there is nothing."""

    @property
    def kind(self) -> ExportKind:
        """The kind of export that is chosen."""
        return KINDS[self.choice.what]

    def begin(self, what: What = "scene") -> None:
        """Reset the choice; by default the whole scene is exported."""
        self.choice = ExportChoice(what)
        document = self._context.document
        # Once, since counting a million splats takes longer than a frame; nothing changes while the dialog is open.
        self.amounts = {name: kind.amount(document) for name, kind in KINDS.items()} if document is not None else {}
        keys = self._context.state.path_keys
        count = format_count(len(keys), "key")
        self.amounts["film"] = phrase("{keys}, {time:.1f} s", keys=count, time=keys[-1].at - keys[0].at) if keys else ""

    def propose_path(self) -> Path:
        """Propose a path for the choice, in the folder of the last export or of the scene."""
        near = self._files.last_export or self._files.path
        return find_folder_beside(near) / self._propose_name()

    def propose_path_in(self, path: str) -> Path:
        """Propose a path for the choice, in the folder of a path as it is typed."""
        folder = Path(os.path.expanduser(path))  # unlike Path's methods these never raise, whatever is typed
        return (folder if os.path.isdir(folder) else folder.parent) / self._propose_name()

    def _propose_name(self) -> str:
        source, document = self._files.path, self._context.document
        stem = source.name.split(".")[0].removesuffix("_edited") if source else "scene"
        selected = document.find_selected_instances() if document else ()
        if self.choice.what == "selection" and document is not None and len(selected) == 1:
            return f"{stem}_{make_file_name(document.scene.table[selected[0]].name)}.ply"
        return f"{stem}{self.kind.suggestion}"

    def write(self, path: Path, choice: ExportChoice | None = None) -> None:
        """Write a choice, by default that of the dialog, as it is at the shown time."""
        document = self._context.document
        if document is None:
            return
        if is_source(path, document):
            self._context.messages.error(
                phrase("{name} is the scene that the edits build on. Export under another name", name=path.name)
            )
            return
        request = ExportRequest.capture(document, path, choice or self.choice, self._context.state)
        write = KINDS[request.choice.what].write

        def finish(message: str) -> None:
            self._files.last_export = path
            self._context.messages.info(message)

        self._context.jobs.submit(phrase("Exporting {name}", name=path.name), lambda: write(request), finish)
