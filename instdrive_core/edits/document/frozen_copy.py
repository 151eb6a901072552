"""A document as it is now, for work on another thread while the user goes on editing."""

from __future__ import annotations

from copy import copy

from instdrive_core.edits.document.document import Document
from instdrive_core.instances.table import InstanceTable


def freeze_document(document: Document, keeps_ids: bool = False) -> Document:
    """A document of its own without history or colours that shares all arrays which edits never write.

    It costs four bytes per splat, for the instance IDs. Splats that are taken away by undo and replaced by others later
    may change in it: `fingerprint` tells whether what was found out still holds.

    Whoever `keeps_ids` does no edit in it that writes instance IDs: copies made in a row then share theirs, too, which
    take all of the time.
    """
    document.run_deferred()
    scene = copy(document.scene)
    scene.gaussians = copy(document.scene.gaussians)
    scene.instance_ids = document.keep_instance_ids() if keeps_ids else document.scene.instance_ids.copy()
    scene.table = InstanceTable(dict(document.scene.table.instances))
    scene.extra = dict(document.scene.extra)
    frozen = Document(scene, document.first_free_id, like=document)
    frozen.adopt_instance_index(document)
    frozen.set_first_tracks(document.first_tracks)
    frozen.replace_surroundings(scene.views, scene.sky, document.orientation)
    return frozen


def freeze_colored(document: Document) -> Document:
    """Freeze a document with its colours, to be drawn on another thread."""
    frozen = freeze_document(document)
    frozen.colors = document.colors.fork()
    return frozen
