"""Scenes as .compressed.ply files (SuperSplat, PlayCanvas): 16 bytes per splat plus one byte per SH coefficient.

256 splats share a chunk: the bounds of their positions, log scales and colours as float32. Each splat stands in four
words relative to its chunk's bounds (`packed_words`), its SH coefficients above the constant follow as bytes.

What is kept, as the largest difference after writing and reading, with the chunk's extent per axis or channel:

- positions: extent / 4094 in x and z, extent / 2046 in y;
- log scales: the same of their extent, inside [-20, 20] (values beyond become the limit);
- colour: extent / 510, on `sh_dc` divided by 0.282;
- opacity: 1/510 (in [0, 1], not of the logit);
- rotation: an angle of 0.28°;
- SH above the constant: 1/64, 1/32 next to the limits -4 and 4 (values beyond become the limit).

Splats near each other go into one chunk so that extents are small; rows change their order for it, unless they are in
a good one. Comments keep the scene's origin and whether it is antialiased. Instance IDs, codewords, features, names,
other columns, sky and camera views have no place in the file and are left out; a plain .ply or a scene folder keeps
them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.export_checks import check_numbers, check_static
from instdrive_core.formats.ply.comments import build_comments, parse_comments
from instdrive_core.formats.ply.compressed_layout import (
    BOUNDS,
    CHUNK,
    COLOR_BOUNDS,
    PACKED,
    CompressedLayout,
    Table,
    read_compressed_layout,
)
from instdrive_core.formats.ply.packed_words import (
    COLOR_BITS,
    VECTOR_BITS,
    decode_sh_bytes,
    encode_sh_bytes,
    pack_rotations,
    pack_units,
    unpack_rotations,
    unpack_units,
)
from instdrive_core.formats.spatial_order import sort_spatially
from instdrive_core.instances.table import InstanceTable
from instdrive_core.maths.activations import logit, sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians

BLOCK_ROWS = 32 * CHUNK
"""Rows converted at a time, so that the temporary arrays stay small."""
LOG_SCALE_LIMIT = 20.0


def read_compressed_ply(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .compressed.ply. Raises DataError where anything about it is wrong."""
    path = Path(path)
    with path.open("rb") as file, np.errstate(invalid="ignore", over="ignore"):
        # Bounds that are no numbers give splats that are none, as a .ply of such values does.
        layout = read_compressed_layout(file, path, path.stat().st_size)
        count, rest = layout.vertices.count, layout.sh_count
        gaussians = allocate_gaussians(path, count, rest, 0, options)
        bounds = _read_bounds(file, layout, path)
        for rows, vertices in _read_blocks(file, layout.vertices, path):
            source, target = options.locate_rows(rows.start, rows.stop)
            chunks = np.arange(rows.start, rows.stop)[source] // CHUNK
            _decode(vertices[source], bounds[chunks], target, gaussians)
        if layout.sh is not None:
            for rows, stored in _read_blocks(file, layout.sh, path):
                source, target = options.locate_rows(rows.start, rows.stop)
                for index in range(3 * rest):
                    gaussians.sh_rest[target, index % rest, index // rest] = decode_sh_bytes(
                        stored[f"f_rest_{index}"][source]
                    )
    notes = parse_comments(layout.comments, path)
    return replace(scene_from_gaussians(gaussians), origin=notes.origin, antialiased=notes.antialiased)


def write_compressed_ply(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment, atomically; what has no place in the file is left out (see above).

    Raises DataError where the scene has moving actors, or values that are no numbers.
    """
    check_static(path, scene, ".compressed.ply")
    gaussians = scene.gaussians
    for start in range(0, len(scene), BLOCK_ROWS):
        _check(path, gaussians.select(slice(start, start + BLOCK_ROWS)), start)
    order = sort_spatially(gaussians.means, CHUNK)
    blocks = [order[start : start + BLOCK_ROWS] for start in range(0, len(order), BLOCK_ROWS)]
    none = np.empty((0, len(BOUNDS)), np.float32)
    bounds = np.concatenate([none, *(_compute_bounds(_collect_quantities(gaussians, rows)) for rows in blocks)])
    with open_atomically(path) as file:
        file.write(_build_header(scene))
        file.write(bounds.astype("<f4").tobytes())
        for number, rows in enumerate(blocks):
            first = number * BLOCK_ROWS // CHUNK
            file.write(_encode(gaussians, rows, bounds[first : first + BLOCK_ROWS // CHUNK]).data)
            report(number / len(blocks))
        if gaussians.sh_degree:
            for rows in blocks:
                # Channel by channel, as f_rest stands in a plain .ply.
                file.write(encode_sh_bytes(gaussians.sh_rest[rows].transpose(0, 2, 1).astype(np.float64)).tobytes())


def _read_bounds(file: BinaryIO, layout: CompressedLayout, path: Path) -> ndarray:
    """(chunks, 18) float64 in the order of BOUNDS."""
    bounds = np.empty((layout.chunks.count, len(BOUNDS)))
    bounds[:, BOUNDS.index(COLOR_BOUNDS[0]) :] = (0, 0, 0, 1, 1, 1)
    for rows, chunks in _read_blocks(file, layout.chunks, path):
        for column, name in enumerate(BOUNDS):
            if name in (chunks.dtype.names or ()):
                bounds[rows, column] = chunks[name]
    return bounds


def _read_blocks(file: BinaryIO, table: Table, path: Path) -> Iterator[tuple[slice, ndarray]]:
    file.seek(table.offset)
    for start in range(0, table.count, BLOCK_ROWS):
        wanted = min(BLOCK_ROWS, table.count - start)
        rows = np.fromfile(file, table.dtype, wanted)
        if len(rows) < wanted:
            problem = f"the file ends after {start + len(rows)} of {table.count} rows of an element"
            raise DataError(path, problem, "It changed while it was read; open it again")
        yield slice(start, start + wanted), rows
        report(start / table.count)


def _decode(vertices: ndarray, bounds: ndarray, rows: slice, gaussians: Gaussians) -> None:
    """Fill `rows` from words and the bounds of each one's chunk."""
    native = {name: vertices[name].astype(np.uint32) for name in PACKED}
    colors = unpack_units(native["packed_color"], COLOR_BITS)
    units = [
        unpack_units(native["packed_position"], VECTOR_BITS),
        unpack_units(native["packed_scale"], VECTOR_BITS),
        colors[:, :3],
    ]
    mine = bounds.reshape(-1, 3, 2, 3)
    means, log_scales, shown = (
        low * (1 - unit) + high * unit for unit, (low, high) in zip(units, mine.transpose(1, 2, 0, 3), strict=True)
    )
    gaussians.means[rows], gaussians.log_scales[rows] = means, log_scales
    gaussians.sh_dc[rows] = dc_from_color(shown)
    gaussians.opacity_logits[rows] = logit(colors[:, 3])
    gaussians.quats[rows] = unpack_rotations(native["packed_rotation"])


def _check(path: str | Path, part: Gaussians, start: int) -> None:
    rows = np.arange(start, start + len(part))
    check_numbers(path, "the position", part.means, rows)
    check_numbers(path, "the rotation", part.quats, rows)
    check_numbers(path, "the log scale", part.log_scales, rows, allow_infinite=True)
    check_numbers(path, "the opacity", part.opacity_logits, rows, allow_infinite=True)
    check_numbers(path, "the colour", part.sh_dc, rows)
    check_numbers(path, "an SH coefficient", part.sh_rest, rows, allow_infinite=True)


def _collect_quantities(gaussians: Gaussians, rows: ndarray) -> ndarray:
    """(m, 3, 3) float64: position, log scale and colour of `rows`, what the chunks' bounds are for."""
    parts = (gaussians.means, gaussians.log_scales, gaussians.sh_dc)
    means, log_scales, sh_dc = (part[rows].astype(np.float64) for part in parts)
    return np.stack([means, np.clip(log_scales, -LOG_SCALE_LIMIT, LOG_SCALE_LIMIT), color_from_dc(sh_dc)], axis=1)


def _compute_bounds(quantities: ndarray) -> ndarray:
    """(chunks, 18) float32 in the order of BOUNDS."""
    starts = np.arange(0, len(quantities), CHUNK)
    ends = [ufunc.reduceat(quantities, starts) for ufunc in (np.minimum, np.maximum)]
    return np.stack(ends, axis=2).reshape(len(starts), len(BOUNDS)).astype(np.float32)


def _encode(gaussians: Gaussians, rows: ndarray, bounds: ndarray) -> ndarray:
    """(m, 4) uint32: the words of `rows`, which begin a chunk."""
    mine = bounds[np.arange(len(rows)) // CHUNK].reshape(-1, 3, 2, 3).astype(np.float64)
    low, extent = mine[:, :, 0], mine[:, :, 1] - mine[:, :, 0]
    units = (_collect_quantities(gaussians, rows) - low) / np.where(extent > 0, extent, 1)
    opacity = sigmoid(gaussians.opacity_logits[rows].astype(np.float64))
    words = np.empty((len(rows), len(PACKED)), "<u4")
    words[:, 0] = pack_units(units[:, 0], VECTOR_BITS)
    words[:, 1] = pack_rotations(gaussians.quats[rows].astype(np.float64))
    words[:, 2] = pack_units(units[:, 1], VECTOR_BITS)
    words[:, 3] = pack_units(np.column_stack([units[:, 2], opacity]), COLOR_BITS)
    return words


def _build_header(scene: Scene) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0"]
    without_instances = replace(scene, table=InstanceTable(), code_bits=0)
    lines += [f"comment {comment}" for comment in build_comments(without_instances)]
    lines += [f"element chunk {-(-len(scene) // CHUNK)}", *(f"property float {name}" for name in BOUNDS)]
    lines += [f"element vertex {len(scene)}", *(f"property uint {name}" for name in PACKED)]
    rest = 3 * scene.gaussians.sh_rest.shape[1]
    if rest:
        lines += [f"element sh {len(scene)}", *(f"property uchar f_rest_{index}" for index in range(rest))]
    return "\n".join([*lines, "end_header", ""]).encode()
