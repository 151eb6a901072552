"""Every command of the editor: one file per menu or topic, each with ``commands(session) -> list[Command]``.

A new command goes into the file of its topic; a new topic is a file and a place in `TOPICS`, whose order is that of
the menus and of the items in them.
"""

from __future__ import annotations

from instdrive_app.actions import (
    aftermath,
    edit,
    file,
    help,
    move,
    panels,
    reference,
    repair,
    select,
    time_steps,
    tools,
    view,
)
from instdrive_app.session.editor_session import EditorSession

TOPICS = (file, edit, select, repair, tools, move, view, aftermath, reference, time_steps, panels, help)


def register_commands(session: EditorSession) -> None:
    """Fill `session.commands`."""
    for topic in TOPICS:
        for command in topic.list_actions(session):
            session.commands.add(command)
