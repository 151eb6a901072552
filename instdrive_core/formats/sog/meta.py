"""The meta.json of a SOG scene, checked: file names, and for each attribute what the bytes of its images mean.

Version 2 looks values up in codebooks; the older one spreads them evenly from a minimum to a maximum. Both become
tables of 256 values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.sog.store import REMEDY
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import REST_COUNTS

PALETTE_LIMIT = 1 << 16
"""Labels have 16 bits."""


@dataclass(frozen=True)
class SogPalette:
    """SH above the constant: each splat names one of `count` entries."""

    count: int | None
    """Entries; None where only the image's size says it."""
    rest: int | None
    """Coefficients per entry (3, 8 or 15); None where only the image's size says it."""
    values: Float32[ndarray, "256"]
    centroids: Any
    labels: Any


@dataclass(frozen=True)
class SogMeta:
    """The content of a meta.json. File names are not checked: the store does that."""

    count: int
    lowest: Float64[ndarray, "3"]
    highest: Float64[ndarray, "3"]
    """Bounds of sign(x) ln(1 + |x|) for positions x."""
    log_scales: Float32[ndarray, "3 256"]
    sh_dc: Float32[ndarray, "3 256"]
    opacity_logits: Float32[ndarray, "256"]
    antialiased: bool
    palette: SogPalette | None
    means_files: tuple[Any, Any]
    quats_file: Any
    scales_file: Any
    sh0_file: Any


def parse_sog_meta(content: dict[str, Any], path: Path) -> SogMeta:
    """Parse a meta.json. Raises DataError where a field is missing or wrong."""
    version = content.get("version", 1)
    if version not in (1, 2):
        raise DataError(path, f"meta.json has 'version' {version!r}, not 2", "Export it as version 2")
    means, scales, sh0 = (_get_object(content, name, path) for name in ("means", "scales", "sh0"))
    if version == 2:
        count = _parse_whole(content.get("count"), "count", path)
        tables = (
            np.tile(_parse_codebook(scales, "scales", path), (3, 1)),
            np.tile(_parse_codebook(sh0, "sh0", path), (3, 1)),
        )
        opacity_logits = logit(np.arange(256) / 255).astype(np.float32)
    else:
        shape = means.get("shape")
        count = _parse_whole(shape[0] if isinstance(shape, list) and shape else None, "means.shape[0]", path)
        colors = _spread_values(sh0, "sh0", 4, path)
        tables, opacity_logits = (_spread_values(scales, "scales", 3, path), colors[:3]), colors[3]
    lowest, highest = _parse_range(means, "means", 3, path)
    if max(np.abs(lowest).max(), np.abs(highest).max()) > 80:
        raise DataError(path, f"'means' reach from {lowest} to {highest}, exponents beyond ±80", REMEDY)
    return SogMeta(
        count=count,
        lowest=lowest,
        highest=highest,
        log_scales=tables[0],
        sh_dc=tables[1],
        opacity_logits=opacity_logits,
        antialiased=content.get("antialias") is True or content.get("model") == "antialiased",
        palette=_parse_palette(content, version, path),
        means_files=_parse_files(means, "means", 2, path),
        quats_file=_parse_files(_get_object(content, "quats", path), "quats", 1, path)[0],
        scales_file=_parse_files(scales, "scales", 1, path)[0],
        sh0_file=_parse_files(sh0, "sh0", 1, path)[0],
    )


def _parse_palette(content: dict[str, Any], version: int, path: Path) -> SogPalette | None:
    if content.get("shN") is None:
        return None
    entry = _get_object(content, "shN", path)
    centroids, labels = _parse_files(entry, "shN", 2, path)
    if version == 1:
        low, high = (_parse_numbers([entry.get(end)], f"shN.{end}", 1, path)[0] for end in ("mins", "maxs"))
        values = np.linspace(low, high, 256).astype(np.float32)
        return SogPalette(None, None, values, centroids, labels)
    count, bands = (_parse_whole(entry.get(name), f"shN.{name}", path) for name in ("count", "bands"))
    if not 1 <= bands <= 3:
        raise DataError(path, f"'shN.bands' is {bands}, not 1 to 3", REMEDY)
    if not 1 <= count <= PALETTE_LIMIT:
        raise DataError(path, f"'shN.count' is {count}, not 1 to {PALETTE_LIMIT}", REMEDY)
    return SogPalette(count, REST_COUNTS[bands], _parse_codebook(entry, "shN", path), centroids, labels)


def _parse_codebook(entry: dict[str, Any], name: str, path: Path) -> Float32[ndarray, "256"]:
    return _parse_numbers(entry.get("codebook"), f"{name}.codebook", 256, path).astype(np.float32)


def _spread_values(entry: dict[str, Any], name: str, channels: int, path: Path) -> Float32[ndarray, "channels 256"]:
    low, high = _parse_range(entry, name, channels, path)
    return (low[:, None] + (high - low)[:, None] * (np.arange(256) / 255)).astype(np.float32)


def _parse_range(entry: dict[str, Any], name: str, length: int, path: Path) -> tuple[ndarray, ndarray]:
    low, high = (_parse_numbers(entry.get(end), f"{name}.{end}", length, path) for end in ("mins", "maxs"))
    return low, high


def _parse_numbers(values: Any, name: str, length: int, path: Path) -> Float64[ndarray, "length"]:
    if not isinstance(values, list) or len(values) != length:
        found = f"a list of {len(values)}" if isinstance(values, list) else repr(values)[:80]
        raise DataError(path, f"meta.json has as {name!r} {found}, not a list of {length} numbers", REMEDY)
    for value in values:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not abs(value) <= 1e30 or not math.isfinite(value):
            raise DataError(path, f"meta.json has {value!r} in {name!r}, not a finite number", REMEDY)
    return np.array(values, np.float64)


def _parse_whole(value: Any, name: str, path: Path) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 31:
        raise DataError(path, f"meta.json has as {name!r} {value!r}, not a whole number of splats or entries", REMEDY)
    return value


def _get_object(content: dict[str, Any], name: str, path: Path) -> dict[str, Any]:
    entry = content.get(name)
    if not isinstance(entry, dict):
        raise DataError(path, f"meta.json has no {name!r} object", REMEDY)
    return entry


def _parse_files(entry: dict[str, Any], name: str, length: int, path: Path) -> tuple[Any, ...]:
    files = entry.get("files")
    if not isinstance(files, list) or len(files) != length:
        raise DataError(path, f"meta.json names in '{name}.files' {files!r}, not {length} files", REMEDY)
    return tuple(files)
