"""Keeping views, returning to them, and saving what the view shows as a picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from instdrive_app.action import Action, MenuItem
from instdrive_app.actions.conditions import is_editable
from instdrive_app.session.aids.bookmarks import MOST
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPanel
from instdrive_core.wording import phrase

_NONE_KEPT = "Keep a view first (Shift+V)"
_BOOKMARK_WORDS = ("bookmark", "camera", "saved view", "pose")


def list_actions(session: EditorSession) -> list[Action]:
    """List the part of the View menu about screenshots and kept views."""
    return [*_list_screenshots(session), *_list_bookmarks(session)]


def _list_screenshots(session: EditorSession) -> list[Action]:
    def toggle_transparent() -> None:
        session.state.cut_out_screenshots = not session.state.cut_out_screenshots

    sizes = (
        ("screenshot", "Screenshot", "F12", 1.0),
        ("screenshot_2x", "Screenshot at twice the size", "Shift+F12", 2.0),
        ("screenshot_4x", "Screenshot at four times the size", "Ctrl+F12", 4.0),
    )
    return [
        *(
            Action(
                f"view.{name}",
                title,
                partial(session.screenshots.take, factor),
                "View",
                (key,),
                enabled=lambda: is_editable(session),
                icon="ICON_FA_CAMERA",
                words=("picture", "image", "photo", "png", "capture", "save picture", "render"),
                separator=factor == 1.0,
            )
            for name, title, key, factor in sizes
        ),
        Action(
            "view.transparent",
            "Screenshots without background",
            toggle_transparent,
            "View",
            checked=lambda: session.state.cut_out_screenshots,
            icon="ICON_FA_CHESS_BOARD",
            words=("transparent", "alpha", "cut out"),
        ),
    ]


def _list_bookmarks(session: EditorSession) -> list[Action]:
    bookmarks = session.aids.bookmarks

    def has_bookmarks() -> bool:
        return session.document is not None and len(bookmarks) > 0

    def has_current() -> bool:
        return has_bookmarks() and bookmarks.current is not None

    def list_kept() -> list[MenuItem]:
        return [(kept.name, partial(show_bookmark, session, index)) for index, kept in enumerate(bookmarks.kept)]

    def step(count: int) -> Callable[[], None]:
        def run() -> None:
            here = bookmarks.current
            start = (-1 if count > 0 else 0) if here is None else here
            show_bookmark(session, (start + count) % len(bookmarks))

        return run

    def ask_name() -> None:
        bookmarks.named = bookmarks.current
        session.requests.put(ShowPanel("Views"))

    return [
        Action(
            "view.keep",
            "Keep this view",
            partial(keep_view, session),
            "View",
            ("Shift+V",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_BOOKMARK",
            words=_BOOKMARK_WORDS,
            separator=True,
        ),
        Action(
            "view.kept",
            "Go to a kept view",
            lambda: session.requests.put(ShowPanel("Views")),
            "View",
            enabled=has_bookmarks,
            icon="ICON_FA_IMAGES",
            items=list_kept,
            words=_BOOKMARK_WORDS,
            needs=_NONE_KEPT,
        ),
        Action(
            "view.next_kept",
            "Next kept view",
            step(1),
            "View",
            ("PageDown",),
            enabled=has_bookmarks,
            icon="ICON_FA_ANGLES_DOWN",
            words=_BOOKMARK_WORDS,
            needs=_NONE_KEPT,
        ),
        Action(
            "view.previous_kept",
            "Previous kept view",
            step(-1),
            "View",
            ("PageUp",),
            enabled=has_bookmarks,
            icon="ICON_FA_ANGLES_UP",
            words=_BOOKMARK_WORDS,
            needs=_NONE_KEPT,
        ),
        Action(
            "view.rename_kept",
            "Rename the kept view…",
            ask_name,
            "View",
            ("Shift+F2",),
            enabled=has_current,
            icon="ICON_FA_PEN",
            words=_BOOKMARK_WORDS,
            needs="Go to a kept view first",
        ),
        Action(
            "view.delete_kept",
            "Delete the kept view",
            lambda: delete_view(session, bookmarks.current),
            "View",
            ("Shift+Delete",),
            enabled=has_current,
            icon="ICON_FA_TRASH",
            words=_BOOKMARK_WORDS,
            needs="Go to a kept view first",
            undoable=False,
        ),
    ]


def keep_view(session: EditorSession) -> None:
    """Keep the present view, and say under which name."""
    kept = session.aids.bookmarks.keep(session.state.viewpoint, session.state.time)
    if kept is None:
        session.messages.error(phrase("{most} views are kept already; delete some in the Views panel", most=MOST))
    else:
        session.messages.info(phrase("Kept as {name}; Page Up and Page Down go through the kept views", name=kept.name))


def show_bookmark(session: EditorSession, index: int) -> None:
    """Look from a kept view."""
    kept = session.aids.bookmarks.kept[index]
    session.aids.bookmarks.current = index
    session.navigation.look_from_kept(kept.viewpoint, kept.time)


def delete_view(session: EditorSession, index: int | None) -> None:
    """Forget a kept view, and say so."""
    if index is not None:
        name = session.aids.bookmarks.kept[index].name
        session.aids.bookmarks.delete(index)
        session.messages.info(phrase("{name} is no longer kept", name=name))
