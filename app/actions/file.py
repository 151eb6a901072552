"""Opening, exporting, quitting."""

from __future__ import annotations

from instdrive_app.actions.conditions import asking, editable
from instdrive_app.commands import Command
from instdrive_app.session import EditorSession


def commands(session: EditorSession) -> list[Command]:
    """The File menu."""

    def quit_editor() -> None:
        session.quitting = True

    return [
        Command("file.open", "Open…", asking(session, "open"), "File", ("Ctrl+O",), icon="ICON_FA_FOLDER_OPEN"),
        Command(
            "file.export",
            "Export…",
            asking(session, "export"),
            "File",
            ("Ctrl+E",),
            enabled=lambda: editable(session),
            icon="ICON_FA_FILE_EXPORT",
        ),
        Command("file.quit", "Quit", quit_editor, "File", ("Ctrl+Q",), icon="ICON_FA_POWER_OFF", separator=True),
    ]
