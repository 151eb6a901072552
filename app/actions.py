"""Every command of the editor, in menu order."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.commands import Command
from instdrive_app.session import EditorSession
from instdrive_app.state import ViewMode

VIEW_MODE_ICONS = {
    ViewMode.COLOR: "ICON_FA_PALETTE",
    ViewMode.INSTANCE: "ICON_FA_SHAPES",
    ViewMode.CODEWORD: "ICON_FA_BARCODE",
    ViewMode.DEPTH: "ICON_FA_LAYER_GROUP",
}


def register_commands(session: EditorSession) -> None:
    """Fill `session.commands`."""
    for command in (
        *_file_commands(session),
        *_edit_commands(session),
        *_select_commands(session),
        *_view_commands(session),
        *_time_commands(session),
        *_help_commands(session),
    ):
        session.commands.add(command)


def _file_commands(session: EditorSession) -> list[Command]:
    def quit_editor() -> None:
        session.quitting = True

    return [
        Command("file.open", "Open…", _dialog(session, "open"), "File", ("Ctrl+O",), icon="ICON_FA_FOLDER_OPEN"),
        Command(
            "file.export",
            "Export…",
            _dialog(session, "export"),
            "File",
            ("Ctrl+E",),
            enabled=lambda: _editable(session),
            icon="ICON_FA_FILE_EXPORT",
        ),
        Command("file.quit", "Quit", quit_editor, "File", ("Ctrl+Q",), icon="ICON_FA_POWER_OFF", separator=True),
    ]


def _edit_commands(session: EditorSession) -> list[Command]:
    def history_reaches(back: bool) -> bool:
        if session.document is None:
            return False
        history = session.document.history
        return history.cursor > 0 if back else history.cursor < len(history.edits)

    def selected() -> bool:
        return bool(session.selected)

    return [
        Command(
            "edit.undo",
            "Undo",
            session.undo,
            "Edit",
            ("Ctrl+Z",),
            enabled=lambda: history_reaches(back=True),
            icon="ICON_FA_ROTATE_LEFT",
        ),
        Command(
            "edit.redo",
            "Redo",
            session.redo,
            "Edit",
            ("Ctrl+Shift+Z", "Ctrl+Y"),
            enabled=lambda: history_reaches(back=False),
            icon="ICON_FA_ROTATE_RIGHT",
        ),
        Command(
            "edit.delete",
            "Delete",
            lambda: session.delete(session.selected),
            "Edit",
            ("Delete",),
            enabled=selected,
            icon="ICON_FA_TRASH",
            separator=True,
        ),
        Command(
            "edit.recolor",
            "Recolour",
            lambda: session.recolor(session.selected, session.recolor_mode, session.recolor_color),
            "Edit",
            ("C",),
            enabled=selected,
            icon="ICON_FA_PAINTBRUSH",
        ),
        Command(
            "edit.rename",
            "Rename…",
            lambda: session.ask_name(session.selected[0]),
            "Edit",
            ("F2",),
            enabled=lambda: len(session.selected) == 1,
            icon="ICON_FA_PEN",
        ),
        Command(
            "edit.hide",
            "Hide",
            lambda: session.hide(session.selected),
            "Edit",
            ("H",),
            enabled=selected,
            icon="ICON_FA_EYE_SLASH",
            separator=True,
        ),
        Command(
            "edit.solo",
            "Show only the selection",
            lambda: session.solo(session.selected),
            "Edit",
            ("I",),
            enabled=selected,
            icon="ICON_FA_BULLSEYE",
        ),
        Command(
            "edit.show_all",
            "Show all",
            session.show_all,
            "Edit",
            ("Alt+H",),
            enabled=lambda: _editable(session),
            icon="ICON_FA_EYE",
        ),
    ]


def _select_commands(session: EditorSession) -> list[Command]:
    return [
        Command(
            "select.codeword",
            "Extend to the whole codeword",
            lambda: session.select_codeword_of(session.selected[0]),
            "Select",
            ("G",),
            enabled=lambda: len(session.selected) == 1 and session.has_codewords,
            icon="ICON_FA_BARCODE",
        ),
        Command(
            "select.none",
            "Select nothing",
            session.clear_selection,
            "Select",
            ("Escape",),
            enabled=lambda: bool(session.selected),
            icon="ICON_FA_BAN",
        ),
    ]


def _view_commands(session: EditorSession) -> list[Command]:
    def show(mode: ViewMode) -> Callable[[], None]:
        def run() -> None:
            session.state.view_mode = mode

        return run

    def shown(mode: ViewMode) -> Callable[[], bool]:
        return lambda: session.state.view_mode is mode

    modes = [
        Command(
            f"view.{mode.name.lower()}",
            mode.value,
            show(mode),
            "View",
            (str(number),),
            checked=shown(mode),
            icon=VIEW_MODE_ICONS[mode],
        )
        for number, mode in enumerate(ViewMode, start=1)
    ]
    return [
        *modes,
        Command(
            "view.frame",
            "Frame the selection",
            lambda: session.frame(session.selected),
            "View",
            ("F",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_EXPAND",
            separator=True,
        ),
        Command(
            "view.frame_all",
            "Frame everything",
            lambda: session.frame(()),
            "View",
            ("Home",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_MAXIMIZE",
        ),
        _switch(session, "view.sky", "Sky", "show_sky", "ICON_FA_CLOUD_SUN", separator=True),
        _switch(session, "view.outlines", "Outlines", "show_outlines", "ICON_FA_VECTOR_SQUARE"),
    ]


def _time_commands(session: EditorSession) -> list[Command]:
    def has_steps() -> bool:
        return len(session.timeline.steps) > 1

    def play() -> None:
        session.playing = not session.playing

    return [
        Command(
            "time.previous",
            "Previous time step",
            lambda: session.step(-1),
            "Time",
            ("LeftArrow",),
            enabled=has_steps,
            icon="ICON_FA_BACKWARD_STEP",
        ),
        Command(
            "time.play",
            "Play",
            play,
            "Time",
            ("Space",),
            enabled=has_steps,
            checked=lambda: session.playing,
            icon="ICON_FA_PLAY",
        ),
        Command(
            "time.next",
            "Next time step",
            lambda: session.step(1),
            "Time",
            ("RightArrow",),
            enabled=has_steps,
            icon="ICON_FA_FORWARD_STEP",
        ),
    ]


def _help_commands(session: EditorSession) -> list[Command]:
    return [
        Command(
            "help.shortcuts",
            "Keys and mouse",
            _dialog(session, "shortcuts"),
            "Help",
            ("F1",),
            icon="ICON_FA_KEYBOARD",
        ),
    ]


def _dialog(session: EditorSession, which: str) -> Callable[[], None]:
    def run() -> None:
        session.dialog = which

    return run


def _switch(
    session: EditorSession, command_id: str, title: str, field: str, icon: str, separator: bool = False
) -> Command:
    def flip() -> None:
        setattr(session.state, field, not getattr(session.state, field))

    return Command(
        command_id,
        title,
        flip,
        "View",
        checked=lambda: getattr(session.state, field),
        icon=icon,
        separator=separator,
    )


def _editable(session: EditorSession) -> bool:
    return session.document is not None and not session.jobs.blocking
