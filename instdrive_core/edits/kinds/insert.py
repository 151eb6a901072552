"""Inserting another scene."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray

from instdrive_core.edits.bases.append import Addition, AppendEdit, make_unique_track_id
from instdrive_core.edits.bases.parameters import check_vector
from instdrive_core.edits.bases.relabel import MAX_NAME_LENGTH, create_instances
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import phrase


@dataclass
class InsertScene(AppendEdit):
    """All splats, instances and tracks of a scene file, at their own coordinates plus a translation.

    The document keeps its SH degree and feature columns: what the file has beyond them is cut off, what it lacks is 0.
    A file without instances becomes one.
    """

    kind: ClassVar[str] = "insert_scene"
    path: str
    translation: Vector = (0.0, 0.0, 0.0)
    """Metres."""
    digest: str = ""
    """SHA-256 of the file's Gaussians; filled in when first done, so that a replay notices another file."""
    _source: Scene | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.path, str) or not self.path:
            raise EditError(phrase("path {path!r} is no name of a file", path=self.path))
        if not isinstance(self.digest, str):
            raise EditError(phrase("digest {digest!r} is no text", digest=self.digest))
        self.translation = check_vector(self.translation, "translation")

    @classmethod
    def from_scene(cls, source: Scene, path: str, translation: Vector = (0.0, 0.0, 0.0)) -> InsertScene:
        """The edit for a scene that has been opened already: doing it reads nothing.

        Raises EditError where the scene has no splats.
        """
        edit = cls(path, translation, _compute_digest(source.gaussians))
        edit._source = source
        _check_not_empty(source, path)
        return edit

    @property
    def added_instances(self) -> int:
        """How many there will be. Raises ValueError before the scene is opened, by `of` or by doing the edit."""
        if self._source is None:
            raise ValueError(f"{self.path} was not opened yet")
        return len(_find_present_entries(self._source)) or 1

    @property
    def title(self) -> str:
        """``Insert car.ply``."""
        return phrase("Insert {name}", name=Path(self.path).name)

    @property
    def shift(self) -> Vector:
        """The translation."""
        return self.translation

    def build_addition(self, document: Document) -> Addition:
        """The file's rows under IDs, nodes and columns of the document."""
        source = self._open_source(document)
        scene, count = document.scene, len(source)
        ids, entries = _renumber(document, source, Path(self.path).stem)
        nodes = np.where(source.nodes > 0, source.nodes + np.int64(len(scene.actors)), 0)
        taken, tracks = {track.id for track in scene.actors}, []
        for track in source.actors:
            tracks.append(replace(track, id=make_unique_track_id(track.id, taken)))
            taken.add(tracks[-1].id)
        if nodes.max(initial=0) > np.iinfo(np.uint16).max:
            raise EditError(
                phrase(
                    "{path}: with its {count} moving objects the scene would have too many",
                    path=self.path,
                    count=len(tracks),
                )
            )
        same_code = source.code_bits == scene.code_bits
        added = Scene(
            _fit_columns(source.gaussians, scene.gaussians),
            ids,
            source.codewords if same_code else np.zeros(count, np.uint32),
            nodes.astype(np.uint16),
            actors=(*scene.actors, *tracks),
            extra={name: _take_column(source, name, column) for name, column in scene.extra.items()},
        )
        if not same_code:
            entries = tuple(replace(entry, codeword=0) for entry in entries)
        zeros = np.zeros(count, np.uint16)
        return Addition(added, zeros, zeros, entries, tuple(tracks))

    def _open_source(self, document: Document) -> Scene:
        """The file's scene, kept for redo: the file may be gone by then."""
        if self._source is None:
            if document.open_scene is None:
                raise EditError(
                    phrase("{path} cannot be inserted: this document was not told how to open files", path=self.path)
                )
            self._source = document.open_scene(Path(self.path))
            digest = _compute_digest(self._source.gaussians)
            if self.digest not in ("", digest):
                self._source = None
                raise EditError(phrase("{path} is no longer the file that was inserted; restore it", path=self.path))
            self.digest = digest
        _check_not_empty(self._source, self.path)
        return self._source


def _check_not_empty(source: Scene, path: str) -> None:
    if not len(source):
        raise EditError(phrase("{path} has no splats", path=path))


def _find_present_entries(source: Scene) -> list[Instance]:
    return [entry for entry in source.table if entry.count]


def _renumber(document: Document, source: Scene, name: str) -> tuple[ndarray, tuple[Instance, ...]]:
    """Each row's new ID, and the new entries of the table."""
    found = _find_present_entries(source)
    if not found:
        like = [Instance(0, name[:MAX_NAME_LENGTH] or "inserted")]
        if source.actors:
            raise EditError("the scene to be inserted has moving objects but no instances")
        entry = replace(create_instances(document, like)[0], name=like[0].name)
        return np.full(len(source), entry.id, np.uint32), (entry,)
    fresh = create_instances(document, found)
    actors = len(document.scene.actors)
    entries = [
        replace(entry, name=old.name, node=old.node + actors if old.node else 0)
        for entry, old in zip(fresh, found, strict=True)
    ]
    known = np.array([old.id for old in found], np.uint32)
    place = np.minimum(np.searchsorted(known, source.instance_ids), len(known) - 1)
    new = np.array([entry.id for entry in entries], np.uint32)
    return np.where(known[place] == source.instance_ids, new[place], np.uint32(0)), tuple(entries)


def _fit_columns(gaussians: Gaussians, like: Gaussians) -> Gaussians:
    """Fit Gaussians to the SH and feature columns of `like`: cut columns off, or add zeros."""
    rest = _resize_columns(gaussians.sh_rest, like.sh_rest.shape[1])
    return replace(gaussians, sh_rest=rest, features=_resize_columns(gaussians.features, like.features.shape[1]))


def _resize_columns(array: Float32[ndarray, "n k *c"], columns: int) -> Float[ndarray, "n {columns} *c"]:
    result = np.zeros((len(array), columns, *array.shape[2:]), array.dtype)
    shared = min(columns, array.shape[1])
    result[:, :shared] = array[:, :shared]
    return result


def _take_column(source: Scene, name: str, like: ndarray) -> ndarray:
    if name in source.extra and np.can_cast(source.extra[name].dtype, like.dtype):
        return source.extra[name].astype(like.dtype)
    return np.zeros(len(source), like.dtype)


def _compute_digest(gaussians: Gaussians) -> str:
    digest = hashlib.sha256()
    for array in gaussians.arrays().values():
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()
