"""Scenes in a .ksplat: positions in buckets, linear scales, colours of 8 bits. The axes are the .ply's."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.ksplat.layout import (
    LEVELS,
    REMEDY,
    SH_COUNTS,
    KsplatHeader,
    Section,
    locate_buckets,
    read_bucket_middles,
    read_headers,
)
from instdrive_core.formats.scene_format import Format
from instdrive_core.maths.activations import logit
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians

_BLOCK_ROWS = 65536


def read_ksplat(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .ksplat. Where sections have different SH degrees, the scene has the highest.

    Raises DataError where headers, counts or buckets do not fit, or a scale is negative.
    """
    path = Path(path)
    with path.open("rb") as file:
        header, sections = read_headers(file, path, path.stat().st_size)
        rest = max(SH_COUNTS[section.sh_degree] for section in sections)
        gaussians = allocate_gaussians(path, header.count, rest, 0, options)
        gaussians.sh_rest[:] = 0
        start = 0
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # not a number in, not a number out
            for section in sections:
                _read_section(file, section, header, gaussians, start, options, path)
                start += section.count
    return scene_from_gaussians(gaussians)


def _read_section(
    file: BinaryIO,
    section: Section,
    header: KsplatHeader,
    gaussians: Gaussians,
    first: int,
    options: ReadOptions,
    path: Path,
) -> None:
    """Read the splats of a section into the rows from `first` on."""
    ends = middles = None
    if np.issubdtype(LEVELS[header.level].centre, np.integer):
        ends, middles = locate_buckets(file, section, path), read_bucket_middles(file, section, path)
    file.seek(section.splat_start)
    for start in range(0, section.count, _BLOCK_ROWS):
        wanted = min(_BLOCK_ROWS, section.count - start)
        records = np.fromfile(file, section.record, wanted)
        if len(records) < wanted:
            raise DataError(path, "the file ends within the splats of a section", REMEDY)
        source, rows = options.locate_rows(first + start, first + start + wanted)
        kept = records[source]
        centres = kept["centre"].astype(np.float64)
        if ends is not None and middles is not None:
            buckets = np.searchsorted(ends, np.arange(start, start + wanted)[source], side="right")
            centres = (centres - section.middle) * section.step + middles[buckets]
        gaussians.means[rows] = centres
        _decode(kept, section, header, gaussians, rows, path)
        report((first + start) / header.count)


def _decode(
    records: ndarray, section: Section, header: KsplatHeader, gaussians: Gaussians, rows: slice, path: Path
) -> None:
    scales = records["scale"].astype(np.float64)
    if (scales < 0).any():
        raise DataError(path, f"the scale of a splat is {scales.min():g}, below 0", REMEDY)
    gaussians.log_scales[rows] = np.log(scales)  # a flat splat's scale of 0 is -inf as a logarithm, as in a .ply
    color = records["color"] / 255.0
    gaussians.sh_dc[rows] = dc_from_color(color[:, :3])
    gaussians.opacity_logits[rows] = logit(color[:, 3])
    gaussians.quats[rows] = normalize_quaternions(records["rotation"].astype(np.float32))
    if section.sh_degree:
        low, high = header.sh_range
        harmonics = records["harmonics"].astype(np.float32)
        if records["harmonics"].dtype == np.uint8:
            harmonics = low + harmonics / 255 * (high - low)
        gaussians.sh_rest[rows, : SH_COUNTS[section.sh_degree]] = _sort_harmonics(harmonics)


def _sort_harmonics(values: ndarray) -> ndarray:
    """Sort (n, 9 or 24) coefficients, by degree and within it by colour, into (n, 3 or 8, 3)."""
    degrees = np.split(values, [9], axis=1) if values.shape[1] > 9 else [values]
    by_color = [part.reshape(len(values), 3, part.shape[1] // 3) for part in degrees]
    return np.concatenate([part.transpose(0, 2, 1) for part in by_color], axis=1)


KSPLAT = Format("mkkellogg's viewer", ".ksplat", read_ksplat)
