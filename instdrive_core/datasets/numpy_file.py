"""What NumPy raises for .npy and .npz files that are damaged."""

from __future__ import annotations

import tokenize
import zipfile
import zlib

BAD_ARRAY = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error),
    # Headers are Python literals, and those of old versions are taken apart as Python source.
    *(tokenize.TokenError, SyntaxError, RecursionError),
)
