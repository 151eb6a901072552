"""`instdrive edit`: the editor window."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from instdrive_app.files.file_names import join_names
from instdrive_app.files.sample import NoSceneError, find_sample_scene
from instdrive_core.errors import InstDriveError

if TYPE_CHECKING:
    from instdrive_app.shell.window_layout import WindowOptions

MIN_SCALE, MAX_SCALE = 0.5, 4.0


class ScaleError(InstDriveError):
    """Text and widgets cannot be drawn at this size."""


def edit(
    scene: Positional[Path | None] = None,
    *,
    size: tuple[int, int] = (1280, 720),
    scale: float = 0.0,
    report: Annotated[Path | None, arg(metavar="FILE")] = None,
    remember_layout: bool = True,
    language: Literal["", "en", "de"] = "",
) -> None:
    """Open a scene in the editor window.

    Args:
        scene: A scene file, a run or scene folder, or a project; without one the sample scene is opened.
        size: Width and height of the window, at scale 1.
        scale: Size of text and widgets, e.g. 2 on a high-density display; 0: as the monitor reports.
        report: Write the window's state as JSON lines into this file, for programs that drive the window.
        language: Language of the window for this time: en or de; without it, as chosen in Preferences.
        remember_layout: Keep the arrangement of panels from one session to the next.
    """
    if scale and not MIN_SCALE <= scale <= MAX_SCALE:
        raise ScaleError(f"--scale {scale:g}: must be 0 or between {MIN_SCALE:g} and {MAX_SCALE:g}")
    from instdrive_app.log_file import start_logging
    from instdrive_app.shell.window_layout import WindowOptions

    path = find_scene(scene)
    start_logging()
    run_editor(path, WindowOptions(size, report, remember_layout, scale, language))


def find_scene(path: Path | None) -> Path:
    """The path, or that of the sample scene where there is none. Raises NoSceneError where nothing is there."""
    path = path if path is not None else find_sample_scene()
    if not path.exists():
        raise NoSceneError(f"{path}: there is no such file or folder. Check the path")
    return path


def run_editor(path: Path, options: WindowOptions | None = None, left_out: Sequence[Path] = ()) -> None:
    """Open a scene or project in the window, and return when it closes; the user is told which paths are `left_out`.

    Raises DisplayError where no window can be opened.
    """
    from instdrive_app.session.editor_session import EditorSession
    from instdrive_app.shell.window import EditorWindow, require_display

    require_display()
    session = EditorSession()
    session.state.shows_first_steps = not session.preferences.current.knows_first_steps
    window = EditorWindow(session, options)
    session.files.open(path)
    if left_out:
        session.messages.info(f"One scene is open at a time: {path.name}. Left out: {join_names(left_out)}")
    session.files.offer_recovery()
    session.making.offer_unfinished()
    window.run()
