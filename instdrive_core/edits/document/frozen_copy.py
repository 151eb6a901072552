"""A document as it is now, for work on another thread while the user goes on editing."""

from __future__ import annotations

import hashlib
from copy import copy, deepcopy

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.instances.table import InstanceTable
from instdrive_core.scene.selection import Flag


def freeze_document(document: Document) -> Document:
    """A document of its own without history, colours or first tracks that shares all arrays which edits never write.

    It costs a few bytes per splat. Splats that are taken away by undo and replaced by others later may change in it:
    `fingerprint` tells whether what was found out still holds.
    """
    document.run_deferred()
    scene = copy(document.scene)
    scene.gaussians = copy(document.scene.gaussians)
    scene.instance_ids = document.scene.instance_ids.copy()
    scene.table = InstanceTable(dict(document.scene.table.instances))
    scene.extra = dict(document.scene.extra)
    frozen = Document(scene)
    for flag in Flag:
        frozen.state.change(document.state.rows_with(flag), flag, True)
    frozen.transforms, frozen.orientation = deepcopy(document.transforms), document.orientation
    return frozen


def fingerprint(document: Document) -> bytes:
    """Equal for equal contents: labels, moves, and which splats are deleted or locked."""
    digest = hashlib.blake2b(digest_size=16)
    flags = document.state.flags & np.uint8(Flag.DELETED | Flag.LOCKED)
    for array in (flags, document.scene.instance_ids, document.transforms.indices, document.transforms.values):
        digest.update(np.ascontiguousarray(array).data)
    return digest.digest()
