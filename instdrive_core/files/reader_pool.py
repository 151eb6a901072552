"""Threads that read parts of a large scene side by side."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

READERS = 2
"""Parts that are read at a time: the window draws meanwhile."""


@contextmanager
def open_reader_pool() -> Iterator[ThreadPoolExecutor]:
    """Open threads of which, after an error or a cancellation, none begins anything more."""
    pool = ThreadPoolExecutor(READERS, "scene-reader")
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
