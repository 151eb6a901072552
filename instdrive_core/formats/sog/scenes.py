"""Scenes in PlayCanvas's SOG: lossless WebP images whose bytes are quantised attributes, and a meta.json.

Read from a .sog archive, a meta.json with its images beside it, or a scene in levels of detail (`levels`).
A splat is one pixel of each image; its values come out exactly as the file defines them, so that what differs from the
scene that was packed was lost in packing:

- positions: half a step of 1/65535 of the range of sign(x) ln(1 + |x|), times 1 + |x| metres;
- log scales and `sh_dc`: half the gap to the next of 256 codebook values; opacity 1/510;
- rotation: an angle of 1.1°; SH above the constant: the distance to the nearest palette entry (up to 65536).

Axes are those of the .ply.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int64, UInt8
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.sog.meta import PALETTE_LIMIT, SogMeta, SogPalette, parse_sog_meta
from instdrive_core.formats.sog.store import REMEDY, Store, open_sog_archive
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians

META = "meta.json"
PALETTE_COLUMNS = 64
"""Palette entries in one row of their image."""
BLOCK_ROWS = 16384
PASSING = 24
"""Bytes per splat of images that are in memory together, as the file has them and in colours of 8 bits."""
FIRST_TAG = 252
"""Alpha of a rotation's pixel: this where w is left out, then x, y, z."""
OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


def read_sog(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .sog archive. Raises DataError where anything about it is wrong, also where names lead out of it."""
    with open_sog_archive(Path(path)) as store:
        return read_sog_meta_scene(store, META, options)


def read_sog_meta_scene(store: Store, name: str, options: ReadOptions = WHOLE) -> Scene:
    """Read the scene of one meta.json, whose images lie beside it. Raises DataError."""
    meta = parse_sog_meta(store.read_json(name), store.path)
    return replace(scene_from_gaussians(read_sog_gaussians(store, meta, options)), antialiased=meta.antialiased)


def read_sog_gaussians(store: Store, meta: SogMeta, options: ReadOptions = WHOLE) -> Gaussians:
    """Read the Gaussians that a meta.json describes. Raises DataError."""
    check_plausible_count(store.path, meta.count, store.size)
    entries = None if meta.palette is None else _read_palette(meta.palette, store)
    rest = 0 if entries is None else entries.shape[1]
    gaussians = allocate_gaussians(store.path, meta.count, rest, 0, options, passing=PASSING)
    if meta.palette is not None and entries is not None:
        labels = _read_labels(meta, meta.palette, store, len(entries), options)
        np.take(entries, labels, axis=0, out=gaussians.sh_rest)
    report(0.2)
    _fill_means(meta, store, gaussians, options)
    report(0.5)
    tags = _read_splat_pixels(store, meta.quats_file, meta.count, options)
    for rows in _list_row_blocks(len(gaussians)):
        gaussians.quats[rows] = _decode_rotations(tags[rows], rows.start, store.path)
    report(0.7)
    scales = _read_splat_pixels(store, meta.scales_file, meta.count, options)
    colors = _read_splat_pixels(store, meta.sh0_file, meta.count, options)
    for channel in range(3):
        gaussians.log_scales[:, channel] = meta.log_scales[channel][scales[:, channel]]
        gaussians.sh_dc[:, channel] = meta.sh_dc[channel][colors[:, channel]]
    gaussians.opacity_logits[:] = meta.opacity_logits[colors[:, 3]]
    return gaussians


def count_rest(store: Store, meta: SogMeta) -> int:
    """Count the SH coefficients above the constant that a meta.json's splats have. Raises DataError."""
    if meta.palette is None:
        return 0
    return meta.palette.rest or _read_palette(meta.palette, store).shape[1]


def _read_splat_pixels(store: Store, name: object, count: int, options: ReadOptions) -> UInt8[ndarray, "m 4"]:
    """Read the first `count` pixels and keep those asked for; images are rounded up to rows, or to powers of two."""
    pixels = store.read_pixels(name, count, 4 * count + 65536).reshape(-1, 4)[:count]
    return pixels[:: options.keep_every].copy() if options.keep_every > 1 else pixels


def _fill_means(meta: SogMeta, store: Store, gaussians: Gaussians, options: ReadOptions) -> None:
    low, high = (_read_splat_pixels(store, name, meta.count, options) for name in meta.means_files)
    for rows in _list_row_blocks(len(gaussians)):
        steps = low[rows, :3] + high[rows, :3] * 256.0
        logarithms = meta.lowest + (meta.highest - meta.lowest) * (steps / 65535)
        gaussians.means[rows] = np.sign(logarithms) * np.expm1(np.abs(logarithms))


def _decode_rotations(pixels: UInt8[ndarray, "n 4"], start: int, path: Path) -> Float32[ndarray, "n 4"]:
    wrong = np.flatnonzero(pixels[:, 3] < FIRST_TAG)
    if len(wrong):
        problem = f"the rotation of splat {start + wrong[0]} has tag {pixels[wrong[0], 3]}, not {FIRST_TAG} to 255"
        raise DataError(path, problem, REMEDY)
    largest = pixels[:, 3:].astype(np.int64) - FIRST_TAG
    stored = (pixels[:, :3] / 255.0 * 2 - 1) * math.sqrt(0.5)
    units = np.empty((len(pixels), 4))
    np.put_along_axis(units, OTHERS[largest[:, 0]], stored, axis=1)
    rest = np.sqrt(np.maximum(0.0, 1.0 - np.sum(stored**2, axis=1, keepdims=True)))
    np.put_along_axis(units, largest, rest, axis=1)
    return normalize_quaternions(units).astype(np.float32)


def _read_labels(
    meta: SogMeta, palette: SogPalette, store: Store, entries: int, options: ReadOptions
) -> Int64[ndarray, " m"]:
    """Read the palette entry of each splat."""
    pixels = _read_splat_pixels(store, palette.labels, meta.count, options)
    labels = pixels[:, 0].astype(np.int64) + pixels[:, 1].astype(np.int64) * 256
    wrong = np.flatnonzero(labels >= entries)
    if len(wrong):
        problem = f"splat {wrong[0] * options.keep_every} names SH entry {labels[wrong[0]]} of {entries}"
        raise DataError(store.path, problem, REMEDY)
    return labels


def _read_palette(palette: SogPalette, store: Store) -> Float32[ndarray, "p k 3"]:
    image = store.read_pixels(palette.centroids, 1, PALETTE_LIMIT * REST_COUNTS[-1])
    height, width = image.shape[:2]
    rest, count = palette.rest or width // PALETTE_COLUMNS, palette.count or height * PALETTE_COLUMNS
    if rest not in REST_COUNTS[1:] or width != PALETTE_COLUMNS * rest or height * PALETTE_COLUMNS < count:
        problem = f"the SH palette {palette.centroids!r} has {width} × {height} pixels, which fit no {count} entries"
        raise DataError(store.path, problem, REMEDY)
    return palette.values[image[:, :, :3]].reshape(-1, rest, 3)[:count]


def _list_row_blocks(count: int) -> list[slice]:
    return [slice(start, min(start + BLOCK_ROWS, count)) for start in range(0, count, BLOCK_ROWS)]
