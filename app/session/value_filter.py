"""Selecting splats by ranges of their values, with the selection as the preview, and floaters of the whole scene."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from instdrive_app.session.context import SessionContext
from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.splat_values import (
    SPLAT_VALUES,
    FloaterLimits,
    SplatValue,
    Viewing,
    find_rows_in_range,
    find_scene_floaters,
    list_splat_values,
)
from instdrive_core.wording import format_count, phrase

BINS = 60
"""Bars of the histogram."""
COMMON = (0.001, 0.999)
"""Shares of the splats between which the histogram lies, so that strays do not squeeze it."""


class ValueFilter:
    """Knows which value is looked at, how it is spread, and which range of it is selected."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self.value: SplatValue = SPLAT_VALUES[0]
        self.limits = FloaterLimits()
        self._cache: VersionedCache[Float32[ndarray, " n"]] = VersionedCache()
        self._spread: VersionedCache[tuple[Int64[ndarray, " b"], float, float]] = VersionedCache()
        self._range: tuple[Document, str, float, float] | None = None
        self._gesture = 0

    @property
    def choices(self) -> tuple[SplatValue, ...]:
        """What splats of the open document can be selected by."""
        document = self._context.document
        return SPLAT_VALUES if document is None else list_splat_values(document)

    @property
    def range(self) -> tuple[float, float]:
        """The range that is selected; all that the histogram shows where none was chosen."""
        document, name = self._context.document, self.value.name
        if document is not None and self._range is not None and self._range[:2] == (document, name):
            return self._range[2:]
        return self.find_limits()

    def choose(self, name: str) -> None:
        """Look at another value."""
        self.value = next((value for value in self.choices if value.name == name), SPLAT_VALUES[0])
        self._range = None
        self._gesture += 1

    def find_limits(self) -> tuple[float, float]:
        """Find the least and the largest value of the histogram."""
        _, low, high = self._find_spread()
        return low, high

    def count_bins(self) -> Int64[ndarray, " b"]:
        """Count the drawn splats in each bar, from the least value to the largest."""
        return self._find_spread()[0]

    def select_range(self, low: float, high: float) -> None:
        """Select what lies in a range; further ranges of the same value change the same step of the history.

        An end at a limit of the histogram lets in whatever is beyond it.
        """
        document = self._context.document
        if document is None:
            return
        self._range = (document, self.value.name, low, high)
        least, most = self.find_limits()
        bottom, top = -np.inf if low <= least else low, np.inf if high >= most else high
        rows = find_rows_in_range(self._find_values(document), bottom, top)
        self._context.apply(lambda: SelectRows(rows), f"range {self.value.name} {self._gesture}")

    def select_floaters(self) -> None:
        """Select what the limits call floaters, anywhere in the scene; searched in the background."""
        document, limits = self._context.document, self.limits
        if document is None:
            return
        frozen = freeze_document(document)

        def finish(rows: Int64[ndarray, " m"]) -> None:
            if self._context.document is document and len(rows):
                self._context.apply(lambda: SelectRows(rows))
            found = format_count(len(rows), "floater")
            told = phrase("{floaters} found; Delete removes what is selected", floaters=found)
            self._context.messages.info(told if len(rows) else "No floaters")

        self._context.jobs.submit(
            "Looking for floaters", lambda: find_scene_floaters(frozen, limits), finish, modal=False
        )

    def _find_values(self, document: Document) -> Float32[ndarray, " n"]:
        viewing = Viewing(self._context.state.viewpoint.position, self._context.state.time)
        return self._cache.get(document, self._make_key(document), lambda: self.value.compute(document, viewing))

    def _make_key(self, document: Document) -> tuple[Hashable, ...]:
        """All that values depend on."""
        state, versions = self._context.state, document.versions
        seen_from = state.viewpoint.position.tobytes() if self.value.name == "distance" else b""
        return self.value.name, versions.rows, versions.geometry, state.time, seen_from

    def _find_spread(self) -> tuple[Int64[ndarray, " b"], float, float]:
        document = self._context.document
        if document is None:
            return np.zeros(BINS, np.int64), 0.0, 1.0
        values, value = self._find_values(document), self.value

        def compute() -> tuple[Int64[ndarray, " b"], float, float]:
            shown = values[np.isfinite(values) & document.state.drawn]
            if not len(shown):
                return np.zeros(BINS, np.int64), 0.0, 1.0
            low, high = (float(end) for end in np.quantile(shown[:: 1 + len(shown) // 200_000], COMMON))
            high = high if high > low else low + 1e-6
            is_logarithmic = value.is_logarithmic and low > 0
            edges = np.geomspace(low, high, BINS + 1) if is_logarithmic else np.linspace(low, high, BINS + 1)
            edges[[0, -1]] = -np.inf, np.inf
            places = np.searchsorted(edges, shown, "right") - 1
            return np.bincount(places.clip(0, BINS - 1), minlength=BINS), low, high

        # Selecting changes the version of the states, but not which splats are drawn.
        key = (*self._make_key(document), int(np.count_nonzero(document.state.drawn)))
        return self._spread.get(document, key, compute)
