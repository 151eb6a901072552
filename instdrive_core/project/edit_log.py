"""The history as a series of differences: what an autosave journal holds, and how it is read back.

A line says how many edits of the list before it are kept, which follow, and how many of all are done. An undo is a
cursor, a slider's drag the last value that was written, and nothing has to be undone or redone to read it.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.registry import EDIT_KINDS
from instdrive_core.project.packed_lists import Numbers, pack_lists, unpack_lists


@dataclass(frozen=True)
class LoggedHistory:
    """A history at one moment."""

    edits: tuple[Edit, ...] = ()
    cursor: int = 0

    @property
    def done(self) -> tuple[Edit, ...]:
        """The edits before the cursor."""
        return self.edits[: self.cursor]


def diff_histories(before: LoggedHistory, after: LoggedHistory) -> dict[str, Any] | None:
    """The line that leads from one to the other; None where they are the same."""
    keep = count_shared_edits(before.edits, after.edits)
    added = after.edits[keep:]
    if keep == len(before.edits) and not added and before.cursor == after.cursor:
        return None
    line: dict[str, Any] = {"cursor": after.cursor}
    if keep < len(before.edits) or added:
        line |= {"keep": keep, "add": [pack_lists(edit, _to_text) for edit in added]}
    return line


def count_shared_edits(left: tuple[Edit, ...], right: tuple[Edit, ...]) -> int:
    """How many edits both begin with: the same ones, not equal ones."""
    for number, (mine, theirs) in enumerate(zip(left, right, strict=False)):
        if mine is not theirs:
            return number
    return min(len(left), len(right))


@dataclass
class ReadLog:
    """The history that lines lead to."""

    entries: list[Any] = field(default_factory=list)
    """Edits as `pack_lists` JSON."""
    cursor: int = 0
    _numbers: list[int] = field(default_factory=list)
    """One per entry, never given twice."""
    _count: int = 0
    _saved: list[int] | None = None

    def apply_line(self, line: Mapping[str, Any]) -> None:
        """Follow a line of `diff_histories`. Raises KeyError, TypeError or ValueError where it is none."""
        keep = line.get("keep", len(self.entries))
        added = line.get("add", [])
        whole = type(keep) is int and type(line["cursor"]) is int
        if not (whole and 0 <= keep <= len(self.entries) and 0 <= line["cursor"] <= keep + len(added)):
            raise ValueError(f"a line keeps {keep} of {len(self.entries)} edits and does {line['cursor']}")
        unknown = [entry for entry in added if not isinstance(entry, dict) or entry.get("kind") not in EDIT_KINDS]
        if unknown:
            raise ValueError(f"a line holds {str(unknown[0])[:80]!r}, which is no edit of this version")
        del self.entries[keep:], self._numbers[keep:]
        self.entries += added
        self._numbers += range(self._count, self._count + len(added))
        self._count += len(added)
        self.cursor = line["cursor"]

    def set_saved(self, done: int | None) -> None:
        """So many of the edits were done when the document was saved; None = no file holds it. Raises ValueError."""
        if done is not None and not (type(done) is int and 0 <= done <= len(self.entries)):
            raise ValueError(f"a line says that {done!r} of {len(self.entries)} edits were saved")
        self._saved = None if done is None else self._list_work(done)

    @property
    def unsaved(self) -> int:
        """How many changes no file holds: edits done since, and saved ones that were undone; selecting is none."""
        work = set(self._list_work(self.cursor))
        return len(work if self._saved is None else work ^ set(self._saved))

    def unpack_entries(self) -> list[Any]:
        """The edits as `Edit.to_json` gave them."""
        return [unpack_lists(entry, _from_text) for entry in self.entries]

    def _list_work(self, done: int) -> list[int]:
        numbered = zip(self._numbers[:done], self.entries[:done], strict=True)
        return [number for number, entry in numbered if not EDIT_KINDS[entry["kind"]].selects_only]


def _to_text(numbers: Numbers) -> dict[str, Any]:
    return {"shape": numbers.shape, "int64": base64.b64encode(numbers.astype("<i8").data).decode()}


def _from_text(kept: Any) -> Numbers:
    return np.frombuffer(base64.b64decode(kept["int64"]), "<i8").astype(np.int64).reshape(kept["shape"])
