"""Weights of one view after another, put aside until all views have been looked at; large ones wait in a file.

A whole drive's weights are the largest thing that votes hold. In memory they are held once, as one matrix.
"""

from __future__ import annotations

import tempfile
from dataclasses import astuple, dataclass
from types import TracebackType

import numba
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.errors import InstDriveError, format_gigabytes

IN_MEMORY = 2**28
"""Bytes that wait in memory; more waits in a file without a name."""


@dataclass(frozen=True)
class ViewWeights:
    """Weights of one view, Gaussian by Gaussian."""

    rows: Int32[ndarray, " u"]
    """Gaussians that it shows, rising."""
    counts: Int32[ndarray, " u"]
    """In how many of its masks each lies."""
    masks: Int32[ndarray, " k"]
    values: Float32[ndarray, " k"]


class WeightSpool:
    """Takes views in the order of their masks, and gives their weights back as one matrix. Use it in a `with`."""

    def __init__(self, gaussians: int, in_memory: int = IN_MEMORY) -> None:
        self._file = tempfile.SpooledTemporaryFile(max_size=in_memory)  # noqa: SIM115 (closed by __exit__)
        self._sizes: list[tuple[int, int]] = []
        self._starts = np.zeros(gaussians + 1, np.int64)
        """Number of weights of the Gaussian before each place."""
        self._bytes = 0

    def __enter__(self) -> WeightSpool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, view: ViewWeights) -> None:
        """Put one view aside. Raises InstDriveError where the disk is full."""
        self._starts[view.rows + 1] += view.counts
        self._sizes.append((len(view.rows), len(view.masks)))
        try:
            for array in astuple(view):
                self._file.write(np.ascontiguousarray(array).data)
                self._bytes += array.nbytes
        except OSError as error:
            raise InstDriveError(
                f"{tempfile.gettempdir()}: {format_gigabytes(self._bytes)} of weights of masks wait there, and no more "
                f"can be written ({error}). Free some space, or name another folder in TMPDIR."
            ) from error

    def build_matrix(self, masks: int) -> csr_array:
        """Build the (n, m) float32 matrix of all views, whose masks follow one another."""
        indptr = np.cumsum(self._starts)
        total = int(indptr[-1])
        all_masks, all_values = np.empty(total, np.int32), np.empty(total, np.float32)
        places = indptr[:-1].copy()
        self._file.seek(0)
        for shown, weights in self._sizes:
            rows, counts, of_masks = (self._read(count, np.int32) for count in (shown, shown, weights))
            _place_view(rows, counts, of_masks, self._read(weights, np.float32), places, all_masks, all_values)
        if total <= np.iinfo(np.int32).max:
            indptr = indptr.astype(np.int32)
        return csr_array((all_values, all_masks, indptr), shape=(len(self._starts) - 1, masks))

    def _read(self, count: int, kind: type) -> ndarray:
        return np.frombuffer(self._file.read(count * np.dtype(kind).itemsize), kind)


@numba.njit(cache=True, error_model="numpy")
def _place_view(rows, counts, masks, values, places, all_masks, all_values):
    """Write a view's weights behind those of the views before it; `places` moves on."""
    entry = 0
    for k in range(len(rows)):
        place = places[rows[k]]
        for _ in range(counts[k]):
            all_masks[place], all_values[place] = masks[entry], values[entry]
            place += 1
            entry += 1
        places[rows[k]] = place
