"""Point clouds as .ply files: positions and colours, by property name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from instdrive_core.datasets.posed_photos import ListedPoints, check_points
from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.ply_header import REMEDY, read_ply_header
from instdrive_core.files.ply_points import join_ply_points
from instdrive_core.files.ply_rows import read_ply_chunks


def read_point_ply(path: Path) -> ListedPoints:
    """Read positions and 8-bit colours of a .ply file's vertices; points without colours become grey.

    Raises DataError where anything about the file is wrong.
    """
    try:
        with require_plain_file(path).open("rb") as file:
            header = read_ply_header(file, path, path.stat().st_size, "points")
            missing = [axis for axis in "xyz" if axis not in (header.dtype.names or ())]
            if missing:
                raise DataError(path, f"the points have no {', '.join(missing)}", REMEDY)
            chunks = [np.empty(0, header.dtype), *read_ply_chunks(file, header, path)]
    except OSError as error:
        raise DataError(path, f"cannot be read ({error})", REMEDY) from error
    rows = np.concatenate(chunks)
    points, colors = join_ply_points(rows)
    check_points(path, points)
    return ListedPoints(points, np.full((len(rows), 3), 128, np.uint8) if colors is None else colors)
