"""Stepping through the drive, and playing it."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession


def list_actions(session: EditorSession) -> list[Action]:
    """List the Time menu."""

    def has_steps() -> bool:
        return len(session.navigation.timeline.steps) > 1

    def toggle_playing() -> None:
        session.navigation.playing = not session.navigation.playing

    return [
        Action(
            "time.previous",
            "Previous time step",
            lambda: session.navigation.step(-1),
            "Time",
            ("LeftArrow",),
            enabled=has_steps,
            icon="ICON_FA_BACKWARD_STEP",
            needs="This scene shows one moment only",
        ),
        Action(
            "time.play",
            "Play",
            toggle_playing,
            "Time",
            ("Space",),
            enabled=has_steps,
            checked=lambda: session.navigation.playing,
            icon="ICON_FA_PLAY",
            words=("video", "animation"),
            needs="This scene shows one moment only",
        ),
        Action(
            "time.next",
            "Next time step",
            lambda: session.navigation.step(1),
            "Time",
            ("RightArrow",),
            enabled=has_steps,
            icon="ICON_FA_FORWARD_STEP",
            needs="This scene shows one moment only",
        ),
    ]
