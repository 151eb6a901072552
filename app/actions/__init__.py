"""Every command of the editor: one file per menu or topic, each with ``list_actions(session) -> list[Command]``.

A new command goes into the file of its topic; a new topic is a file and a place in `TOPICS`, whose order is that of
the menus and of the items in them.
"""

from __future__ import annotations

from instdrive_app.actions import (
    deletion_review,
    edit,
    file,
    help,
    labels,
    move,
    panels,
    reference,
    select,
    time_steps,
    tools,
    view,
)
from instdrive_app.session.editor_session import EditorSession

TOPICS = (file, edit, select, labels, tools, move, view, deletion_review, reference, time_steps, panels, help)


def register_actions(session: EditorSession) -> None:
    """Fill `session.actions`."""
    for topic in TOPICS:
        for command in topic.list_actions(session):
            session.actions.add(command)
