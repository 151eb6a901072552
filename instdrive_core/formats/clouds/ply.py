"""Points of a .ply that holds no splats."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from instdrive_core.files.ply_header import PlyHeader
from instdrive_core.files.ply_points import join_ply_points
from instdrive_core.files.ply_rows import read_ply_chunks
from instdrive_core.formats.allocation import ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.clouds.points import PASSING, CloudPoints, make_cloud_scene
from instdrive_core.scene.scene import Scene

_OF_SPLATS = ("opacity", "scale_0", "rot_0", "f_dc_0")


def is_point_cloud(header: PlyHeader) -> bool:
    """Whether vertices have positions and nothing that splats have."""
    names = header.dtype.names or ()
    return set("xyz") <= set(names) and not set(_OF_SPLATS) & set(names)


def read_ply_cloud(file: BinaryIO, header: PlyHeader, path: Path, options: ReadOptions) -> Scene:
    """Read the points behind a header as a cloud. Raises DataError."""
    check_memory(path, header.count, count_row_bytes(0, 0) + PASSING, options, PASSING * header.count)
    rows = np.concatenate([np.empty(0, header.dtype), *read_ply_chunks(file, header, path)])
    positions, colors = join_ply_points(rows)
    names = header.dtype.names or ()
    name = next((name for name in ("intensity", "scalar_Intensity") if name in names), None)
    intensities = None if name is None else rows[name].astype(np.float64)
    return make_cloud_scene(path, CloudPoints(positions, colors, intensities), options)
