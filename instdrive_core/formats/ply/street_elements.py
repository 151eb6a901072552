"""StreetGaussians' ``point_cloud/iteration_N/point_cloud.ply``: the background and each object are elements.

Elements are ``vertex_background``, ``vertex_obj_003`` … and, of some versions, ``vertex_sky`` (Yan et al. 2024,
``lib/models/street_gaussian_model.py``). Their columns are INRIA's, with ``semantic_*`` besides; SH degrees may differ.
An object's constant colour is a Fourier series over its frames, channel-major like ``f_rest``: of f coefficients,
``f_dc_0`` … ``f_dc_{f-1}`` are red's. The file holds no tracks; `actors.street_tracks` says where they are found.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.ply_header import REMEDY, PlyHeader, PlyLayout, describe_all_elements
from instdrive_core.files.ply_rows import read_ply_chunks
from instdrive_core.formats.actors.street_scene import (
    STREET_BACKGROUND,
    STREET_SKY,
    assemble_street,
    sort_street_parts,
    weigh_waves,
)
from instdrive_core.formats.actors.street_tracks import STREET_OBJECT, find_street_tracks
from instdrive_core.formats.allocation import ReadOptions, allocate_gaussians
from instdrive_core.formats.ply.columns import check_columns, count_waves, view_columns
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

_PREFIX = "vertex_"


def is_street_ply(layout: PlyLayout) -> bool:
    """Whether a header names StreetGaussians' elements and no common vertices."""
    names = [element.name for element in layout.elements]
    return "vertex" not in names and any(_is_part(name) for name in names)


def read_street_ply(file: BinaryIO, layout: PlyLayout, path: Path, options: ReadOptions) -> Scene:
    """Read the background and the objects with the tracks that are found. `file` stands behind the header.

    Raises DataError, SceneTooLargeError.
    """
    headers = describe_all_elements(layout, path, path.stat().st_size)
    parts = {name.removeprefix(_PREFIX): header for name, header in headers.items() if _is_part(name)}
    left_out = [f"the rows of {name[:80]!r}, which is no part of a street" for name in headers if not _is_part(name)]
    shapes = {name: _check_part(header, path) for name, header in parts.items()}
    if not sum(header.count for header in parts.values()):
        raise DataError(path, "the file holds no splats", REMEDY)
    tracks = find_street_tracks(path, [name for name in parts if STREET_OBJECT.fullmatch(name)], options.data, left_out)
    order = sort_street_parts(list(parts), tracks)
    counts = [parts[name].count for name in order]
    starts = dict(zip(order, np.cumsum([0, *counts]).tolist(), strict=False))
    most = max(rest for rest, _ in shapes.values())
    gaussians = allocate_gaussians(path, sum(counts), most, 0, options)
    gaussians.sh_rest[:] = 0
    done = 0
    for element, header in headers.items():
        name = element.removeprefix(_PREFIX)
        if not _is_part(element):
            if header.is_ascii:  # what follows begins where it ends
                for _ in read_ply_chunks(file, replace(header, skipped_lines=0), path):
                    pass
            continue
        rest, waves = shapes[name]
        still = name in (STREET_BACKGROUND, STREET_SKY)
        weights = np.eye(1, waves)[0] if still else weigh_waves(tracks.get(name), options.time, waves)
        _read_part(file, header, path, gaussians, starts[name], (rest, weights), options)
        done += header.count
        report(done / sum(counts))
    rows = {
        name: slice(options.count_kept(starts[name]), options.count_kept(starts[name] + parts[name].count))
        for name in order
    }
    left_out += _list_losses(path, parts, shapes)
    return assemble_street(gaussians, rows, tracks, options.time, None, left_out)


def _is_part(element: str) -> bool:
    name = element.removeprefix(_PREFIX)
    is_known = name in (STREET_BACKGROUND, STREET_SKY) or STREET_OBJECT.fullmatch(name) is not None
    return element.startswith(_PREFIX) and is_known


def _check_part(header: PlyHeader, path: Path) -> tuple[int, int]:
    """SH coefficients above the constant, and coefficients of the constant colour over time."""
    names = header.dtype.names or ()
    return check_columns(names, path)[0], count_waves(names, path)


def _read_part(
    file: BinaryIO,
    header: PlyHeader,
    path: Path,
    gaussians: Gaussians,
    begin: int,
    shape: tuple[int, Float64[ndarray, " f"]],
    options: ReadOptions,
) -> None:
    """Read an element's rows into the Gaussians from row `begin` of all, with a number of SH coefficients and weights
    of the constant colour's."""
    rest, weights = shape
    waves = len(weights)
    targets = view_columns(replace(gaussians, sh_rest=gaussians.sh_rest[:, :rest]))
    for channel in range(3):
        del targets[f"f_dc_{channel}"]
    start = begin
    for chunk in read_ply_chunks(file, replace(header, skipped_lines=0), path):
        source, target = options.locate_rows(start, start + len(chunk))
        for name, column in targets.items():
            column[target] = chunk[name][source]
        for channel in range(3):
            series = np.stack([chunk[f"f_dc_{channel * waves + wave}"][source] for wave in range(waves)], axis=-1)
            with np.errstate(over="ignore", invalid="ignore"):  # the linter reports what is not finite
                gaussians.sh_dc[target, channel] = series[:, 0] if waves == 1 else series @ weights
        start += len(chunk)


def _list_losses(path: Path, parts: dict[str, PlyHeader], shapes: dict[str, tuple[int, int]]) -> list[str]:
    losses = []
    if any(waves > 1 for _, waves in shapes.values()):
        losses.append("how the objects' colours change: all have those of one frame")
    if any("semantic_0" in (header.dtype.names or ()) for header in parts.values()):
        losses.append("semantic values per splat, which no palette names")
    run = path.absolute().parent
    checkpoint = run.parent.parent / "trained_model" / f"{run.name}.pth"
    if STREET_SKY not in parts and checkpoint.is_file():
        losses.append(f"the sky, which a .ply has no place for: open {checkpoint} to have it")
    return losses
