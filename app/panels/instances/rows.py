"""Which instances the list shows, in which order; computed when something changes, not in every frame."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document, InstanceCounts
from instdrive_core.edits.document.versions import DocumentVersions
from instdrive_core.instances.table import Instance


@dataclass(frozen=True)
class Query:
    """Search, filter and sort order that the user has set."""

    search: str = ""
    """Words that must all occur in number, name or class."""
    class_name: str | None = None
    """Class to list: empty for instances without one, None for all classes."""
    column: str = "#"
    descending: bool = False


@dataclass(frozen=True)
class _States:
    """For each instance that has splats left: their number, and whether it is hidden or locked."""

    ids: ndarray
    left: Int64[ndarray, " m"]
    hidden: Bool[ndarray, " m"]
    locked: Bool[ndarray, " m"]

    @classmethod
    def from_counts(cls, counts: InstanceCounts) -> _States:
        left = counts.count - counts.deleted
        alive = left > 0
        return cls(
            counts.ids[alive],
            left[alive],
            (counts.drawn == 0)[alive],
            (counts.locked >= counts.count - counts.deleted)[alive],
        )

    def equals(self, other: _States | None) -> bool:
        if other is None:
            return False
        pairs = zip(
            (self.ids, self.left, self.hidden, self.locked),
            (other.ids, other.left, other.hidden, other.locked),
            strict=True,
        )
        return all(np.array_equal(one, two) for one, two in pairs)


class InstanceRows:
    """The rows of the list. Call `update` once a frame; it does nothing if nothing has changed."""

    def __init__(self) -> None:
        self.instances: tuple[Instance, ...] = ()
        """The listed instances, in order."""
        self.ids: tuple[int, ...] = ()
        self.place: dict[int, int] = {}
        """Row of each listed instance."""
        self.total = 0
        """Number of instances that have splats left, listed or not."""
        self.classes: tuple[tuple[str, int], ...] = ()
        """Classes with their numbers of instances, in alphabetical order; instances without a class come last."""
        self._document: Document | None = None
        self._versions: DocumentVersions | None = None
        self._states: _States | None = None
        self._query: Query | None = None
        self._alive: list[Instance] = []
        self._left: dict[int, int] = {}
        self._hidden: set[int] = set()
        self._locked: set[int] = set()

    def update(self, document: Document, query: Query) -> None:
        """Bring the rows up to date with the document and the query."""
        before, now = self._versions, document.versions
        table_changed = document is not self._document or before is None or now.table != before.table
        changed = table_changed or query != self._query
        if before is None or table_changed or now.states != before.states:
            states = _States.from_counts(document.count_states())
            changed = changed or not states.equals(self._states)
            if changed:
                self._count(document, states)
        if changed:
            self._sort(query)
        self._document, self._query, self._versions = document, query, now

    def _count(self, document: Document, states: _States) -> None:
        table = document.scene.table
        known = [number in table for number in states.ids.tolist()]
        self._states = states
        self._left = dict(zip(states.ids.tolist(), states.left.tolist(), strict=True))
        self._hidden = set(states.ids[states.hidden].tolist())
        self._locked = set(states.ids[states.locked].tolist())
        self._alive = [table[number] for number, is_known in zip(states.ids.tolist(), known, strict=True) if is_known]
        self.total = len(self._alive)
        numbers: dict[str, int] = {}
        for instance in self._alive:
            numbers[instance.class_name] = numbers.get(instance.class_name, 0) + 1
        self.classes = tuple(sorted(numbers.items(), key=lambda item: (not item[0], item[0].lower())))

    def _sort(self, query: Query) -> None:
        words = query.search.lower().split()
        found = [
            i for i in self._alive if query.class_name in (None, i.class_name) and (not words or matches(i, words))
        ]
        found.sort(key=self._build_sort_key(query.column), reverse=query.descending)
        self.instances = tuple(found)
        self.ids = tuple(instance.id for instance in found)
        self.place = {instance_id: row for row, instance_id in enumerate(self.ids)}

    def _build_sort_key(self, column: str) -> Callable[[Instance], tuple[Any, ...]]:
        keys: dict[str, Callable[[Instance], tuple[Any, ...]]] = {
            "#": lambda i: (i.id,),
            "Code": lambda i: (i.codeword, i.id),
            "Name": lambda i: (build_natural_key(i.name), i.id),
            "Class": lambda i: (not i.class_name, i.class_name.lower(), build_natural_key(i.name)),
            "Splats": lambda i: (self._left[i.id], i.id),
            "Shown": lambda i: (i.id in self._hidden, i.id),
            "Locked": lambda i: (i.id not in self._locked, i.id),
        }
        return keys[column]


def matches(instance: Instance, words: list[str]) -> bool:
    """Whether number, name and class together contain every one of these lower-case words."""
    text = f"{instance.id} {instance.name} {instance.class_name}".lower()
    return all(word in text for word in words)


def build_natural_key(text: str) -> tuple[tuple[int, int, str], ...]:
    """Build a sort key that puts ``car 9`` before ``car 10``."""
    parts = re.split(r"(\d+)", text.lower())
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part)
