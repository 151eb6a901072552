"""Comparing the splats with what the cameras saw."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import Reference


def list_actions(session: EditorSession) -> list[Action]:
    """More of the View menu: photo, masks, side by side."""
    state = session.state

    def through_camera() -> bool:
        return state.dataset_view is not None

    def show(kind: Reference) -> Callable[[], None]:
        def run() -> None:
            state.reference = Reference.NONE if state.reference is kind else kind

        return run

    def beside() -> None:
        state.reference_beside = not state.reference_beside

    return [
        Action(
            "view.photo",
            "Compare with the photo",
            show(Reference.PHOTO),
            "View",
            ("P",),
            enabled=through_camera,
            checked=lambda: state.reference is Reference.PHOTO,
            icon="ICON_FA_IMAGE",
            separator=True,
        ),
        Action(
            "view.masks",
            "Compare with the masks",
            show(Reference.MASKS),
            "View",
            ("Shift+P",),
            enabled=through_camera,
            checked=lambda: state.reference is Reference.MASKS,
            icon="ICON_FA_OBJECT_GROUP",
        ),
        Action(
            "view.beside",
            "Side by side",
            beside,
            "View",
            ("Alt+P",),
            enabled=lambda: through_camera() and state.reference is not Reference.NONE,
            checked=lambda: state.reference_beside,
            icon="ICON_FA_TABLE_COLUMNS",
        ),
    ]
