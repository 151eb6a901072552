"""Scenes as .spz files, versions 1 to 4 (Niantic): quantised, then compressed by gzip (1 to 3) or ZSTD (4).

What is kept, as the largest difference after writing and reading version 4:

- positions: 0.123 mm on each axis inside ±2047 m; twice that for each doubling beyond (version 1: 0.05 %);
- log scales: 1/32 inside [-10, 5.9375], cut off beyond;
- opacity: 1/510 (in [0, 1], not of the logit);
- `sh_dc`: 0.0131 inside ±3.33, cut off beyond;
- SH of degree 1: 0.036, of higher degrees: 0.067, inside ±1, cut off beyond (8 bits asked for: 0.004, and 1/128 at +1);
- rotation: an angle of 0.3° (versions 1 and 2: 14°, near half turns; mostly below 1°).

Rows stay in their order. The file's axes are right, up, back; they are turned to the .ply's right, down, forward, as
the reference implementation does. SH of degree 4 is read as degree 3. Everything else has no place in the file and is
left out: instance IDs, codewords, features, names, other columns, the scene's origin, sky and camera views.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.export_checks import check_numbers, check_static
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.formats.spz import values
from instdrive_core.formats.spz.axes import RUB, AxisFlips, find_flips, parse_axes
from instdrive_core.formats.spz.container import ANTIALIASED, EXTENSIONS, SpzHeader, read_container, write_container
from instdrive_core.maths.activations import logit, sigmoid
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians

logger = logging.getLogger(__name__)

BLOCK_ROWS = 16384
"""Rows converted at a time, so that the temporary arrays stay small."""
HARMONICS_BITS = (5, 4)
"""Kept of the SH's 8 bits, for degree 1 and above; the rest compresses away. As the reference implementation."""
_CHECKED = {  # attribute → field, and whether an infinite value is cut off rather than refused
    "positions": ("means", False),
    "alphas": ("opacity_logits", True),
    "colors": ("sh_dc", True),
    "scales": ("log_scales", True),
    "rotations": ("quats", False),
    "harmonics": ("sh_rest", True),
}


def read_spz(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .spz of any version. Raises DataError where anything about it is wrong."""
    path = Path(path)
    with path.open("rb") as file:
        gaussians, antialiased = decode_spz(file, path, path.stat().st_size, options)
    return replace(scene_from_gaussians(gaussians), antialiased=antialiased)


def decode_spz(
    file: IO[bytes], path: Path, size: int, options: ReadOptions = WHOLE, axes: int | None = None
) -> tuple[Gaussians, bool]:
    """Decode an open .spz of any version, and whether it was trained with antialiasing.

    Args:
        file: at its start.
        path: for messages.
        size: bytes of the file.
        options: which rows are read.
        axes: the system that its numbers are in, whatever it says itself (`RDF` keeps them); None believes the file.

    Raises DataError where anything about it is wrong.
    """
    header, blocks = read_container(file, path, size)
    if header.sh_degree > 3:
        logger.warning("%s: SH of degree %d is read as degree 3", path, header.sh_degree)
    # One attribute at a time is unpacked whole.
    widest = max(header.widths.values())
    gaussians = allocate_gaussians(
        path, header.count, REST_COUNTS[min(header.sh_degree, 3)], 0, options, passing=widest
    )
    system = RUB
    for number, (name, data) in enumerate(blocks):
        report(number / len(header.widths))
        if name == EXTENSIONS:
            system = parse_axes(data.tobytes(), path)
            continue
        for rows in _list_row_blocks(header.count):
            source, target = options.locate_rows(rows.start, rows.stop)
            _decode(name, np.ascontiguousarray(data[rows][source]), gaussians, target, header)
    find_flips(system if axes is None else axes).apply(gaussians)
    return gaussians, bool(header.flags & ANTIALIASED)


def write_spz(
    path: str | Path, scene: Scene, version: int = 4, harmonics_bits: tuple[int, int] = HARMONICS_BITS
) -> None:
    """Write a scene at one moment, atomically; what has no place in the file is left out (see above).

    Args:
        path: the file.
        scene: without moving actors: place them first (`edits.queries.bake.freeze_at_time`).
        version: 1 to 4; older ones for older programs.
        harmonics_bits: 1 to 8 for SH of degree 1, and of higher degrees.

    Raises DataError where the scene has moving actors, or values that are no numbers or too far away.
    """
    check_static(path, scene, ".spz")
    with open_atomically(path) as file:
        encode_spz(file, path, scene.gaussians, scene.antialiased, version, harmonics_bits)


def encode_spz(
    file: IO[bytes],
    path: str | Path,
    gaussians: Gaussians,
    antialiased: bool = False,
    version: int = 4,
    harmonics_bits: tuple[int, int] = HARMONICS_BITS,
    axes: int = RUB,
) -> None:
    """Encode Gaussians into an open file that can be read and sought; `write_spz` says what is lost.

    `axes` is the system that the numbers get (`RDF` keeps them); `path` is named in messages. Raises DataError for
    values that are no numbers or too far away.
    """
    for attribute, (field, allow_infinite) in _CHECKED.items():
        for rows in _list_row_blocks(len(gaussians)):
            part, numbers = getattr(gaussians, field)[rows], np.arange(rows.start, rows.stop)
            check_numbers(path, attribute, part, numbers, allow_infinite)
    flags = ANTIALIASED if antialiased else 0
    header = SpzHeader(
        version, len(gaussians), gaussians.sh_degree, _choose_fractional_bits(path, gaussians, version), flags
    )
    flips = find_flips(axes)
    write_container(
        file,
        header,
        lambda name: (
            _encode(name, gaussians, rows, header, harmonics_bits, flips) for rows in _list_row_blocks(len(gaussians))
        ),
    )
    file.seek(0, 2)
    # What this reader would not believe is not written either.
    check_plausible_count(path, len(gaussians), file.tell())


def _list_row_blocks(count: int) -> Iterator[slice]:
    return (slice(start, min(start + BLOCK_ROWS, count)) for start in range(0, count, BLOCK_ROWS))


def _choose_fractional_bits(path: str | Path, gaussians: Gaussians, version: int) -> int:
    extent = float(np.abs(gaussians.means).max(initial=0))
    bits = values.choose_fractional_bits(extent)
    if bits is None or (version == 1 and extent > 65504):
        limit = 65504 if version == 1 else 2**23 - 1
        problem = f"a splat lies {extent:.6g} m from the scene's origin; version {version} reaches {limit} m"
        raise DataError(path, problem, "Delete strays, or save as .ply")
    return bits


def _decode(name: str, data: UInt8[ndarray, "n w"], gaussians: Gaussians, rows: slice, header: SpzHeader) -> None:
    match name:
        case "positions" if header.version == 1:
            gaussians.means[rows] = values.decode_halves(data)
        case "positions":
            gaussians.means[rows] = values.decode_fixed(data, header.fractional_bits)
        case "alphas":
            gaussians.opacity_logits[rows] = logit(data[:, 0] / 255.0)
        case "colors":
            gaussians.sh_dc[rows] = values.decode_colors(data)
        case "scales":
            gaussians.log_scales[rows] = values.decode_log_scales(data)
        case "rotations" if header.version < 3:
            gaussians.quats[rows] = values.decode_first_three(data)
        case "rotations":
            gaussians.quats[rows] = values.decode_smallest_three(data)
        case "harmonics":
            values.decode_harmonics(data, gaussians.sh_rest[rows])
        case _:
            raise ValueError(f"no stream of SPZ is called {name!r}")


def _encode(
    name: str, gaussians: Gaussians, rows: slice, header: SpzHeader, bits: tuple[int, int], flips: AxisFlips
) -> UInt8[ndarray, "m w"]:
    match name:
        case "positions" if header.version == 1:
            data = values.encode_halves(gaussians.means[rows] * flips.means)
        case "positions":
            data = values.encode_fixed(gaussians.means[rows] * flips.means, header.fractional_bits)
        case "alphas":
            data = values.encode_opacities(sigmoid(gaussians.opacity_logits[rows].astype(np.float64)))
        case "colors":
            data = values.encode_colors(gaussians.sh_dc[rows].astype(np.float64))
        case "scales":
            data = values.encode_log_scales(gaussians.log_scales[rows].astype(np.float64))
        case "rotations":
            encode = values.encode_first_three if header.version < 3 else values.encode_smallest_three
            data = encode(gaussians.quats[rows] * flips.quats)
        case _:
            rest = gaussians.sh_rest[rows]
            data = values.encode_harmonics(rest * flips.sh_rest[: rest.shape[1]], bits)
    return np.ascontiguousarray(data)


def compute_position_error(means: ndarray) -> float:
    """Compute half a step of the fixed-point positions (n, 3), metres."""
    bits = values.choose_fractional_bits(float(np.abs(means).max(initial=0)))
    return 0.5 ** ((bits or 0) + 1) * (1 + 1e-6)


SPZ = Format("Niantic, versions 1 to 4", ".spz", read_spz, write_spz, Fidelity(compute_position_error), up="-y")
"""Files are right, up, back, and are opened as right, down, forward."""
