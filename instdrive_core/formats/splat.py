"""Scenes as .splat files: 32 bytes per splat and no header, the layout of the first WebGL viewers (K. Kwok, 2023).

A record is position (3 float32), standard deviations in metres (3 float32), colour and opacity (4 uint8, RGBA of 0 to
255) and the unit quaternion wxyz (4 uint8, ``128 q + 128``), little-endian, in the axes of the .ply.

What is kept, as the largest difference after writing and reading:

- positions: bit-equal, also where they are not finite;
- log scales: 4e-6, inside [-87, 88] (limits for those beyond; NaN and -inf are kept);
- opacity: 1/510 (in [0, 1], not of the logit);
- colour: 1/510 inside [0, 1], cut off beyond: 0.007 of `sh_dc`;
- rotation: an angle of 0.9°.

Everything else has no place in the file and is left out: SH above the constant, instance IDs, codewords, features,
names, other columns, the scene's origin, sky and camera views.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.export_checks import check_numbers, check_static
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.maths.activations import logit, sigmoid
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians

RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("rotation", "u1", 4)])
BLOCK_ROWS = 8192
"""Rows converted at a time, so that the temporary arrays stay small."""
LOG_SCALE_LIMITS = (-87.0, 88.0)
"""Range in which exp stays a normal float32."""
_OTHER_FILES = {b"ply": ".ply", b"\x1f\x8b": ".spz or .gz", b"PK\x03\x04": ".sog or .zip", b"{": ".json"}


def read_splat(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .splat. Raises DataError where its length or a scale cannot be right."""
    path = Path(path)
    with path.open("rb") as file:
        count = _check_count(path, path.stat().st_size, file.read(4))
        file.seek(0)
        gaussians = allocate_gaussians(path, count, 0, 0, options)
        for start in range(0, count, BLOCK_ROWS):
            wanted = min(BLOCK_ROWS, count - start)
            records = np.fromfile(file, RECORD, wanted)
            if len(records) < wanted:
                problem = f"the file ends after {start + len(records)} of {count} splats"
                raise DataError(path, problem, "It changed while it was read; open it again")
            with np.errstate(invalid="ignore"):  # not a number in, not a number out
                _decode(records, gaussians, start, options, path)
            report(start / count)
    return scene_from_gaussians(gaussians)


def write_splat(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment, atomically; what has no place in the file is left out (see above).

    Raises DataError where the scene has moving actors, no splats, or colours, opacities or rotations that are no
    numbers.
    """
    check_static(path, scene, ".splat")
    if not len(scene):
        raise DataError(path, "the scene has no splats, and an empty .splat cannot be opened", "Save as .ply instead")
    with open_atomically(path) as file:
        for start in range(0, len(scene), BLOCK_ROWS):
            file.write(_encode(path, scene.gaussians, start).data)
            report(start / len(scene))


def _check_count(path: Path, size: int, beginning: bytes) -> int:
    for mark, suffix in _OTHER_FILES.items():
        if beginning.startswith(mark) and (len(mark) > 2 or size % RECORD.itemsize):
            raise DataError(path, f"the content is that of a {suffix} file", f"Rename the file to end in {suffix}")
    if not size:
        raise DataError(path, "the file is empty", "Copy or export it again")
    if size % RECORD.itemsize:
        problem = f"{size} bytes are no whole number of splats of {RECORD.itemsize} bytes"
        raise DataError(path, problem, "The file was cut off or is no .splat; copy or export it again")
    return size // RECORD.itemsize


def _decode(records: ndarray, gaussians: Gaussians, start: int, options: ReadOptions, path: Path) -> None:
    scales = records["scale"].astype(np.float64)
    negative = np.argwhere(scales < 0)
    if len(negative):
        row, axis = negative[0]
        problem = f"scale {axis} of splat {start + row} is {scales[row, axis]:g}, below 0"
        raise DataError(path, problem, "The file is damaged or no .splat; copy or export it again")
    source, rows = options.locate_rows(start, start + len(records))
    records, scales = records[source], scales[source]
    with np.errstate(divide="ignore"):  # a flat splat's scale of 0 is -inf as a logarithm, as in a .ply
        gaussians.log_scales[rows] = np.log(scales)
    color = records["color"] / 255.0
    gaussians.means[rows] = records["position"]
    gaussians.sh_dc[rows] = dc_from_color(color[:, :3])
    gaussians.opacity_logits[rows] = logit(color[:, 3])
    gaussians.quats[rows] = normalize_quaternions((records["rotation"] - 128.0) / 128.0)


def _encode(path: str | Path, gaussians: Gaussians, start: int) -> ndarray:
    rows = np.arange(start, min(start + BLOCK_ROWS, len(gaussians)))
    part = gaussians.select(slice(start, start + BLOCK_ROWS))
    check_numbers(path, "the colour", part.sh_dc, rows, allow_infinite=True)
    check_numbers(path, "the opacity", part.opacity_logits, rows, allow_infinite=True)
    check_numbers(path, "the rotation", part.quats, rows)
    records = np.empty(len(rows), RECORD)
    records["position"] = part.means
    flat = np.isneginf(part.log_scales)
    records["scale"] = np.where(flat, 0, np.exp(np.clip(part.log_scales.astype(np.float64), *LOG_SCALE_LIMITS)))
    records["color"][:, :3] = _round_to_bytes(255 * color_from_dc(part.sh_dc.astype(np.float64)))
    records["color"][:, 3] = _round_to_bytes(255 * sigmoid(part.opacity_logits.astype(np.float64)))
    records["rotation"] = _round_to_bytes(128 * normalize_quaternions(part.quats.astype(np.float64)) + 128)
    return records


def _round_to_bytes(values: ndarray) -> ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


SPLAT = Format("32 bytes per splat, no SH", ".splat", read_splat, write_splat, Fidelity())
