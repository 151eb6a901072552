"""Opening, saving, exporting, quitting."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_app.action import Action, MenuItem
from instdrive_app.actions.conditions import asking, is_editable
from instdrive_app.files.sample import find_sample_scene, has_sample_scene
from instdrive_app.session.editor_session import EditorSession


def list_actions(session: EditorSession) -> list[Action]:
    """The File menu."""
    return [*_opening(session), *_saving(session), *_exporting(session), *_leaving(session)]


def _opening(session: EditorSession) -> list[Action]:
    def opening(path: Path) -> Callable[[], None]:
        return lambda: session.leave(lambda: session.files.open(path))

    def recent() -> list[MenuItem]:
        return [(path.name, opening(path)) for path in session.files.recents.paths]

    return [
        Action("file.open", "Open…", asking(session, "open"), "File", ("Ctrl+O",), icon="ICON_FA_FOLDER_OPEN"),
        Action(
            "file.recent",
            "Open recent",
            asking(session, "open"),
            "File",
            enabled=lambda: bool(session.files.recents.paths),
            icon="ICON_FA_CLOCK_ROTATE_LEFT",
            items=recent,
        ),
        Action(
            "file.sample",
            "Open the sample scene",
            lambda: opening(find_sample_scene())(),
            "File",
            enabled=has_sample_scene,
            icon="ICON_FA_CITY",
        ),
        Action(
            "file.insert",
            "Insert scene…",
            asking(session, "insert"),
            "File",
            ("Ctrl+Shift+I",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_FILE_IMPORT",
            undoable=True,
        ),
    ]


def _saving(session: EditorSession) -> list[Action]:
    def save() -> None:
        if session.files.project is None:
            session.dialog = "save"
        else:
            session.save()

    def can_save() -> bool:
        return is_editable(session) and session.files.path is not None

    return [
        Action(
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
        Action(
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


def _exporting(session: EditorSession) -> list[Action]:
    return [
        Action(
            "file.export",
            "Export…",
            asking(session, "export"),
            "File",
            ("Ctrl+E",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_FILE_EXPORT",
            undoable=False,
        ),
        Action(
            "file.export_selection",
            "Export selection…",
            asking(session, "export_selection"),
            "File",
            ("Ctrl+Shift+E",),
            enabled=lambda: is_editable(session) and session.has_selection,
            icon="ICON_FA_ARROW_UP_RIGHT_FROM_SQUARE",
            undoable=False,
        ),
    ]


def _leaving(session: EditorSession) -> list[Action]:
    return [
        Action(
            "file.quit",
            "Quit",
            lambda: session.leave(session.quit),
            "File",
            ("Ctrl+Q",),
            icon="ICON_FA_POWER_OFF",
            separator=True,
        ),
    ]
