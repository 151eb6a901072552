"""Gaussians × camera → per-pixel channels, on the CPU.

Numba's default threading layer aborts the process when two Python threads run parallel kernels at once, and the
editor draws beside loading and saving, so the layer is pinned here, before any kernel is launched.
"""

from __future__ import annotations

import ctypes
import importlib.metadata

from numba.core import config


def _load_tbb() -> None:
    """Make the `tbb` package's library known to the loader: pip puts it where Numba does not look."""
    try:
        files = importlib.metadata.files("tbb") or []
    except importlib.metadata.PackageNotFoundError:
        return  # no such package on this platform; Numba takes OpenMP
    names = ("libtbb.so.12", "libtbb.12.dylib", "tbb12.dll")
    for file in files:
        if file.name in names:
            ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)


_load_tbb()
# Numba wants all three named; OpenMP is part of it, so the third is never reached where TBB is missing.
config.THREADING_LAYER_PRIORITY = ["tbb", "omp", "workqueue"]  # pyright: ignore[reportAttributeAccessIssue]
