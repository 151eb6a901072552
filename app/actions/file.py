"""Opening, saving, exporting, quitting."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_app.actions.conditions import asking, editable
from instdrive_app.commands import Command, MenuItem
from instdrive_app.files.sample import has_sample_scene, sample_scene
from instdrive_app.session.editor_session import EditorSession


def commands(session: EditorSession) -> list[Command]:
    """The File menu."""
    return [*_opening(session), *_saving(session), *_exporting(session), *_leaving(session)]


def _opening(session: EditorSession) -> list[Command]:
    def opening(path: Path) -> Callable[[], None]:
        return lambda: session.leave(lambda: session.files.open(path))

    def recent() -> list[MenuItem]:
        return [(path.name, opening(path)) for path in session.files.recents.paths]

    return [
        Command("file.open", "Open…", asking(session, "open"), "File", ("Ctrl+O",), icon="ICON_FA_FOLDER_OPEN"),
        Command(
            "file.recent",
            "Open recent",
            asking(session, "open"),
            "File",
            enabled=lambda: bool(session.files.recents.paths),
            icon="ICON_FA_CLOCK_ROTATE_LEFT",
            items=recent,
        ),
        Command(
            "file.sample",
            "Open the sample scene",
            lambda: opening(sample_scene())(),
            "File",
            enabled=has_sample_scene,
            icon="ICON_FA_CITY",
        ),
        Command(
            "file.insert",
            "Insert scene…",
            asking(session, "insert"),
            "File",
            ("Ctrl+Shift+I",),
            enabled=lambda: editable(session),
            icon="ICON_FA_FILE_IMPORT",
            undoable=True,
        ),
    ]


def _saving(session: EditorSession) -> list[Command]:
    def save() -> None:
        if session.files.project is None:
            session.dialog = "save"
        else:
            session.save()

    def can_save() -> bool:
        return editable(session) and session.files.path is not None

    return [
        Command(
            "file.save",
            "Save project",
            save,
            "File",
            ("Ctrl+S",),
            enabled=can_save,
            icon="ICON_FA_FLOPPY_DISK",
            undoable=False,
            separator=True,
        ),
        Command(
            "file.save_as",
            "Save project as…",
            asking(session, "save"),
            "File",
            ("Ctrl+Shift+S",),
            enabled=can_save,
            icon="ICON_FA_FILE_PEN",
            undoable=False,
        ),
    ]


def _exporting(session: EditorSession) -> list[Command]:
    return [
        Command(
            "file.export",
            "Export…",
            asking(session, "export"),
            "File",
            ("Ctrl+E",),
            enabled=lambda: editable(session),
            icon="ICON_FA_FILE_EXPORT",
            undoable=False,
        ),
        Command(
            "file.export_selection",
            "Export selection…",
            asking(session, "export_selection"),
            "File",
            ("Ctrl+Shift+E",),
            enabled=lambda: editable(session) and session.has_selection,
            icon="ICON_FA_ARROW_UP_RIGHT_FROM_SQUARE",
            undoable=False,
        ),
    ]


def _leaving(session: EditorSession) -> list[Command]:
    return [
        Command(
            "file.quit",
            "Quit",
            lambda: session.leave(session.quit),
            "File",
            ("Ctrl+Q",),
            icon="ICON_FA_POWER_OFF",
            separator=True,
        ),
    ]
