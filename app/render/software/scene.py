"""What the render thread knows of a document.

Ownership: only the UI thread writes the document's arrays. There, `SceneWatcher` takes a `SceneState`: it shares the
arrays that edits write to as they are (the next edit writes to a copy of its own), copies instance IDs and nodes when
their version has risen, and shares those that edits never write to (means, harmonics …). A state never changes, so
states can wait, be skipped or be drawn twice.
`PlacedSplats` belongs to the render thread; it compares each state with the last one and recomputes what differs.

New splats are appended behind the end of the shared arrays, where earlier states do not look.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8, UInt16, UInt32
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.versions import DocumentVersions
from instdrive_core.instances.shadows import name_splats
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track


@dataclass(frozen=True)
class SceneState:
    """A document at one moment of editing; nothing in it is ever written again."""

    gaussians: Gaussians
    nodes: UInt16[ndarray, " n"]
    codewords: UInt32[ndarray, " n"]
    instance_ids: UInt32[ndarray, " n"]
    flags: UInt8[ndarray, " n"]
    color_entries: UInt16[ndarray, " n"]
    color_values: Float32[ndarray, "p 30"]
    move_entries: UInt16[ndarray, " n"]
    move_matrices: Float64[ndarray, "q 3 4"]
    actors: tuple[Track, ...]
    sky: Sky | None
    antialiased: bool
    names: Int32[ndarray, " k"]
    """What a pixel of each splat stands for (`name_splats`)."""
    rows_version: int
    """Rises when the shared arrays get other rows."""


class SceneWatcher:
    """Takes states of one document on the UI thread; parts that have not changed are shared with the last state."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._state: SceneState | None = None
        self._versions = document.versions

    def take_state(self) -> SceneState:
        """Take the present state; it is the same object as before if nothing has changed."""
        document = self._document
        versions = document.versions
        if self._state is None or versions.rows != self._versions.rows:
            self._state = _copy_document(document)
        elif versions != self._versions:
            self._state = self._update_parts(self._state, self._versions, versions)
        self._versions = versions
        return self._state

    def _update_parts(self, state: SceneState, before: DocumentVersions, now: DocumentVersions) -> SceneState:
        document, parts = self._document, {}
        if now.table != before.table and not np.array_equal(document.scene.instance_ids, state.instance_ids):
            parts |= {"instance_ids": document.scene.instance_ids.copy()}
        if now.states != before.states:
            parts |= {"flags": document.state.share_rows()}
        if now.colors != before.colors:
            parts |= _copy_colors(document)
        if now.transforms != before.transforms:
            parts |= _copy_moves(document)
        if now.tracks != before.tracks:
            parts |= {"actors": document.scene.actors, "nodes": document.scene.nodes.copy()}
        if now.surroundings != before.surroundings:
            parts |= {"sky": document.scene.sky}
        return replace(state, **parts) if parts else state


def _copy_document(document: Document) -> SceneState:
    scene = document.scene
    return SceneState(
        gaussians=Gaussians(**scene.gaussians.arrays()),
        nodes=scene.nodes.copy(),
        codewords=scene.codewords,
        instance_ids=scene.instance_ids.copy(),
        flags=document.state.share_rows(),
        actors=scene.actors,
        sky=scene.sky,
        antialiased=scene.antialiased,
        names=name_splats(scene.extra),
        rows_version=document.versions.rows,
        **_copy_colors(document),
        **_copy_moves(document),
    )


def _copy_colors(document: Document) -> dict[str, ndarray]:
    return {"color_entries": document.colors.share_rows(), "color_values": document.colors.values.copy()}


def _copy_moves(document: Document) -> dict[str, ndarray]:
    return {"move_entries": document.transforms.share_rows(), "move_matrices": document.transforms.matrices.copy()}
