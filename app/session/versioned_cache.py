"""One value, worked out again only where something has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar
from weakref import ref

from instdrive_core.edits.document.document import Document

Value = TypeVar("Value")


class VersionedCache(Generic[Value]):
    """The last value asked for, with the document and the key that it was worked out from."""

    def __init__(self) -> None:
        self._last: tuple[ref[Document], tuple[Any, ...], Value] | None = None

    def of(self, document: Document, key: tuple[Any, ...], work_out: Callable[[], Value]) -> Value:
        """The value for a document and a key: versions of what it depends on, and whatever else it does."""
        # Not by the document's address, which another one may have once this one is closed.
        if self._last is None or self._last[0]() is not document or self._last[1] != key:
            self._last = (ref(document), key, work_out())
        return self._last[2]
