"""The moments of the drive."""

from __future__ import annotations

from instdrive_app.commands import Command
from instdrive_app.session.editor_session import EditorSession


def commands(session: EditorSession) -> list[Command]:
    """The Time menu."""

    def has_steps() -> bool:
        return len(session.navigation.timeline.steps) > 1

    def play() -> None:
        session.navigation.playing = not session.navigation.playing

    return [
        Command(
            "time.previous",
            "Previous time step",
            lambda: session.navigation.step(-1),
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
            checked=lambda: session.navigation.playing,
            icon="ICON_FA_PLAY",
        ),
        Command(
            "time.next",
            "Next time step",
            lambda: session.navigation.step(1),
            "Time",
            ("RightArrow",),
            enabled=has_steps,
            icon="ICON_FA_FORWARD_STEP",
        ),
    ]
