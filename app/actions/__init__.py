"""All actions of the editor: one file per menu or topic, each with ``list_actions(session) -> list[Action]``.

A new action goes into the file of its topic; a new topic is a file and a place in `TOPICS`, whose order is that of
the menus and of the items in them.
"""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.actions import (
    aids,
    camera_path,
    deletion_review,
    edit,
    ego_way,
    file,
    help,
    labels,
    move,
    pictures,
    reference,
    select,
    time_steps,
    tools,
    view,
    ways,
)
from instdrive_app.session.editor_session import EditorSession

TOPICS = (
    file,
    edit,
    select,
    labels,
    tools,
    aids,
    move,
    ways,
    ego_way,
    view,
    pictures,
    deletion_review,
    reference,
    time_steps,
    camera_path,
)


def register_actions(session: EditorSession, *more: Callable[[EditorSession], list[Action]]) -> None:
    """Fill `session.actions`; `more` lists the actions of further menus, which come before Help."""
    for list_actions in (*(topic.list_actions for topic in TOPICS), *more, help.list_actions):
        for action in list_actions(session):
            session.actions.add(action)
