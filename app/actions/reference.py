"""Comparing the splats with photos and masks."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import Comparison, Reference, ViewMode

_KINDS: tuple[tuple[str, str, Comparison, str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("view.beside", "Side by side", Comparison.BESIDE, "ICON_FA_TABLE_COLUMNS", ("Alt+P",), ("compare", "split")),
    ("view.wipe", "Wipe", Comparison.WIPE, "ICON_FA_LEFT_RIGHT", (), ("compare", "curtain", "slider")),
    ("view.flicker", "Flicker", Comparison.FLICKER, "ICON_FA_BOLT", (), ("compare", "blink", "toggle")),
    (
        "view.error",
        "Heat map of the difference",
        Comparison.ERROR,
        "ICON_FA_FIRE",
        (),
        ("compare", "error", "PSNR", "quality"),
    ),
)


def list_actions(session: EditorSession) -> list[Action]:
    """List the part of the View menu about photo, masks, and how they are compared with the splats."""
    state = session.state

    def looks_through_camera() -> bool:
        if state.dataset_view is None or session.document is None:
            return False
        return bool(session.document.scene.views[state.dataset_view].photo) or state.reference is not Reference.NONE

    def show(kind: Reference) -> Callable[[], None]:
        def run() -> None:
            state.reference = Reference.NONE if state.reference is kind else kind
            if state.comparison is Comparison.ERROR:  # of photos only
                state.comparison = Comparison.OVER

        return run

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
        *(
            Action(
                name,
                title,
                _create_toggle(session, kind),
                "View",
                keys,
                enabled=looks_through_camera,
                checked=lambda kind=kind: state.reference is not Reference.NONE and state.comparison is kind,
                icon=icon,
                words=words,
                needs="Look through a camera that has photos",
            )
            for name, title, kind, icon, keys, words in _KINDS
        ),
    ]


def _create_toggle(session: EditorSession, kind: Comparison) -> Callable[[], None]:
    """Show the photo, or the masks that are shown, in this way; where that is so already, over the splats again."""
    state = session.state

    def run() -> None:
        if state.reference is not Reference.NONE and state.comparison is kind:
            state.comparison = Comparison.OVER
            return
        state.comparison = kind
        if state.reference is Reference.NONE or kind is Comparison.ERROR:
            state.reference = Reference.PHOTO
        if kind is Comparison.ERROR:
            state.view_mode = ViewMode.COLOR

    return run
