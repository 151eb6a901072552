"""A value that is computed again only when something has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar
from weakref import ref

from instdrive_core.edits.document.document import Document

Value = TypeVar("Value")


class VersionedCache(Generic[Value]):
    """Keeps the last value, with the document and the key it was computed from."""

    def __init__(self) -> None:
        self._last: tuple[ref[Document], tuple[Any, ...], Value] | None = None

    def get(self, document: Document, key: tuple[Any, ...], compute: Callable[[], Value]) -> Value:
        """Return the value for a document and a key: versions and everything else that the value depends on."""
        # Not by the document's id, which another document may get once this one is closed.
        if self._last is None or self._last[0]() is not document or self._last[1] != key:
            self._last = (ref(document), key, compute())
        return self._last[2]
