"""Comparing the splats with photos and masks."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import Reference


def list_actions(session: EditorSession) -> list[Action]:
    """List the part of the View menu about photo, masks and side by side."""
    state = session.state

    def looks_through_camera() -> bool:
        if state.dataset_view is None or session.document is None:
            return False
        return bool(session.document.scene.views[state.dataset_view].photo) or state.reference is not Reference.NONE

    def show(kind: Reference) -> Callable[[], None]:
        def run() -> None:
            state.reference = Reference.NONE if state.reference is kind else kind

        return run

    def toggle_beside() -> None:
        state.reference_beside = not state.reference_beside

    return [
        Action(
            "view.photo",
            "Compare with the photo",
            show(Reference.PHOTO),
            "View",
            ("P",),
            enabled=looks_through_camera,
            checked=lambda: state.reference is Reference.PHOTO,
            icon="ICON_FA_IMAGE",
            needs="Look through a camera that has photos",
            separator=True,
        ),
        Action(
            "view.masks",
            "Compare with the masks",
            show(Reference.MASKS),
            "View",
            ("Shift+P",),
            enabled=looks_through_camera,
            checked=lambda: state.reference is Reference.MASKS,
            icon="ICON_FA_OBJECT_GROUP",
            needs="Look through a camera that has masks",
        ),
        Action(
            "view.beside",
            "Side by side",
            toggle_beside,
            "View",
            ("Alt+P",),
            enabled=lambda: looks_through_camera() and state.reference is not Reference.NONE,
            checked=lambda: state.reference_beside,
            icon="ICON_FA_TABLE_COLUMNS",
            needs="Show the photo or the masks first",
        ),
    ]
