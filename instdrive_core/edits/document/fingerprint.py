"""Digests of a document's contents, equal for equal bits, on any thread and in any process."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum

import numpy as np
from numpy import ndarray

from instdrive_core.edits.document.array_digest import digest_array
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.selection import Flag


class Part(Enum):
    """A part of what edits decide."""

    SPLATS = "stored parameters, codewords, nodes and extra columns of all splats"
    REMOVALS = "which splats are deleted or locked"
    VISIBILITY = "which splats are selected or hidden"
    LABELS = "the instance of each splat"
    TABLE = "names, classes, counts and bounds of instances, and the first free ID"
    COLORS = "entries of the colour palette, and which splat names which"
    TRANSFORMS = "entries of the transform palette, and which splat names which"
    TRACKS = "the actors' tracks, now and before any edit"
    SURROUNDINGS = "photo cameras, exposures, sky, origin and orientation"


CONTENT = (Part.REMOVALS, Part.LABELS, Part.TRANSFORMS)
"""What answers about a scene's objects depend on, and cheap: 8 bytes per splat are read."""


_LARGE = 1 << 16
"""Bytes from which on an array's digest is taken instead of all its bytes."""


def fingerprint(document: Document, parts: Collection[Part] = tuple(Part)) -> bytes:
    """Digest (16 bytes) of everything that edits decide, or of some parts of it.

    Documents of the same scene with equal fingerprints show the same, bit by bit. All parts take some 50 ms for a
    million splats, `CONTENT` one.
    """
    digest = hashlib.blake2b(digest_size=16)
    for part in Part:
        if part in parts:
            digest.update(part.name.encode())
            for value in _list_values(document, part):
                _feed(digest, value)
    return digest.digest()


def _list_values(document: Document, part: Part) -> Iterator[object]:
    scene, flags = document.scene, document.state.flags
    match part:
        case Part.SPLATS:
            yield from (scene.gaussians, scene.codewords, scene.nodes, dict(sorted(scene.extra.items())))
        case Part.REMOVALS:
            yield flags & np.uint8(Flag.DELETED | Flag.LOCKED)
        case Part.VISIBILITY:
            yield flags & np.uint8(Flag.SELECTED | Flag.HIDDEN)
        case Part.LABELS:
            yield scene.instance_ids
        case Part.TABLE:
            yield from (tuple(scene.table), document.first_free_id)
        case Part.COLORS:
            yield from (document.colors.indices, document.colors.values)
        case Part.TRANSFORMS:
            yield from (document.transforms.indices, document.transforms.values)
        case Part.TRACKS:
            yield scene.actors
            yield from (document.get_first_track(node) for node in range(1, len(scene.actors) + 1))
        case Part.SURROUNDINGS:
            yield from (scene.views, scene.exposures, scene.sky, scene.origin, document.orientation)


def _feed(digest: hashlib.blake2b, value: object) -> None:
    """Add arrays with their type and shape, and whatever holds arrays; anything else as it prints."""
    if isinstance(value, ndarray):
        digest.update(f"{value.dtype.str} {value.shape}".encode())
        digest.update(digest_array(value) if value.nbytes >= _LARGE else np.ascontiguousarray(value).data)
    elif is_dataclass(value) and not isinstance(value, type):
        for entry in fields(value):
            _feed(digest, getattr(value, entry.name))
    elif isinstance(value, Mapping):
        for key, part in value.items():
            digest.update(repr(key).encode())
            _feed(digest, part)
    elif isinstance(value, tuple | list):
        digest.update(str(len(value)).encode())
        for part in value:
            _feed(digest, part)
    else:
        digest.update(repr(value).encode())
