"""Paints the map's picture on a thread of its own, whenever the scene or the shown part of the ground has changed."""

from __future__ import annotations

import logging
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from weakref import ref

import numpy as np

from instdrive_app.session.context import SessionContext
from instdrive_app.session.mapping.map_picture import MapPicture, draw_map, extract_ground
from instdrive_app.session.mapping.map_window import MapWindow
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_colored
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import phrase

_log = logging.getLogger(__name__)
SETTLE_SECONDS = 0.15
"""Time for which window and scene stay as they are before they are painted."""
Key = tuple[object, ...]


class MapPainter:
    """Keeps the last picture; while another one is painted, that is shown in the right place."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="map")
        self._wanted: tuple[Key, MapWindow] | None = None
        self._waited = 0.0
        self._running: tuple[Key, MapWindow, Future[tuple[Scene, MapPicture]]] | None = None
        self._ground: tuple[Key, Scene] | None = None
        self._found: tuple[Key, MapPicture] | None = None
        self._drawn: tuple[object, int, int] | None = None
        self._failed: Key | None = None
        self._is_shown = False

    @property
    def is_painting(self) -> bool:
        """Whether the map is shown and its picture is awaited."""
        return self._is_shown and (self._running is not None or self._waited < 0)

    @property
    def window(self) -> MapWindow | None:
        """The part of the ground that the map shows; None while it is not shown."""
        return self._wanted[1] if self._is_shown and self._wanted is not None else None

    @property
    def picture(self) -> MapPicture | None:
        """The last picture of the open document; None before the first one."""
        document = self._context.document
        if self._found is None or document is None or self._found[0][0] != ref(document):
            return None
        return self._found[1]

    def begin_frame(self) -> None:
        """Begin a frame of the editor's window: the map is not shown until `update` is called."""
        self._is_shown = False

    def update(self, window: MapWindow, seconds: float) -> None:
        """Ask for the picture of a window; called in every frame that shows the map, `seconds` after the last."""
        document = self._context.document
        if document is None:
            return
        self._is_shown = True
        self._collect()
        key = self._build_key(document)
        if (key, window) != self._wanted:
            self._wanted, self._waited = (key, window), -SETTLE_SECONDS
            if self._found is None or self._found[0][0] != key[0]:
                self._waited = 0.0  # the first picture need not wait
        else:
            self._waited = min(self._waited + seconds, 0.0)
        is_current = self._found is not None and self._found[0] == key and self._found[1].window == window
        if self._running is None and not is_current and self._waited >= 0 and self._failed != key:
            self._begin(document, key, window)

    def close(self) -> None:
        """Stop the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _build_key(self, document: Document) -> Key:
        """What the picture shows, but for the window: not what is selected, and not what drives."""
        versions = document.versions
        if self._drawn is None or self._drawn[:2] != (ref(document), versions.states):
            drawn = np.packbits(document.state.drawn.astype(bool)).tobytes()
            self._drawn = (ref(document), versions.states, zlib.crc32(drawn))
        return (
            ref(document),
            versions.rows,
            self._drawn[2],
            versions.colors,
            versions.transforms,
            versions.table,
            versions.surroundings,
        )

    def _begin(self, document: Document, key: Key, window: MapWindow) -> None:
        known = self._ground[1] if self._ground is not None and self._ground[0] == key else None
        frozen = None if known is not None else freeze_colored(document)

        def work() -> tuple[Scene, MapPicture]:
            ground = extract_ground(frozen) if frozen is not None else known
            assert ground is not None
            return ground, draw_map(ground, window)

        future = self._pool.submit(work)
        self._running = (key, window, future)
        future.add_done_callback(lambda _: self._context.wake())

    def _collect(self) -> None:
        """Take the finished picture; a failure is a bug, which is logged and told once."""
        if self._running is None or not self._running[2].done():
            return
        key, _, future = self._running
        self._running = None
        error = future.exception()
        if error is not None:
            self._failed = key
            _log.error("the map could not be painted", exc_info=error)
            self._context.messages.error(
                phrase("The map cannot be shown: {error!r}. Help › Log file has more", error=error)
            )
            return
        ground, picture = future.result()
        self._ground, self._found = (key, ground), (key, picture)
