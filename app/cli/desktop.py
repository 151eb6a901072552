"""The editor as the desktop starts it: by a double click, without a terminal to write errors to."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from instdrive_app.cli.edit import find_scene, run_editor
from instdrive_app.log_file import get_log_path, start_logging
from instdrive_core.errors import InstDriveError

_log = logging.getLogger(__name__)


def start_from_desktop(arguments: Sequence[str]) -> int:
    """Open the editor on the first of these paths, or on the sample scene; returns the exit status.

    What goes wrong before the window opens, or ends it, is logged and shown in a message box of the desktop.
    """
    start_logging()
    paths = [Path(argument) for argument in arguments if argument]
    try:
        run_editor(find_scene(paths[0] if paths else None), left_out=paths[1:])
    except InstDriveError as error:
        _log.error("%s", error)
        show_error(str(error))
        return 2
    except Exception as error:
        _log.exception("the editor ended with an error")
        show_error(f"The editor ended with an error: {error!r}\n\nThe log has the details: {get_log_path()}")
        return 1
    return 0


def show_error(text: str) -> None:
    """Write an error to stderr, where there is one, and show it in a message box, where the desktop has them."""
    if sys.stderr is not None:
        print(f"instdrive: {text}", file=sys.stderr)
    try:
        from imgui_bundle import portable_file_dialogs as desktop

        from instdrive_app.panels.dialogs.file_browser import has_desktop_dialogs
        from instdrive_app.shell.display import has_display

        if has_display() and has_desktop_dialogs():
            desktop.message("InstDrive", text, desktop.choice.ok, desktop.icon.error).result()
    except Exception:  # whatever broke the window may break the message box, too
        _log.exception("the error could not be shown in a message box")
