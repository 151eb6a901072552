"""The .ply twin for viewers that read a fixed record and no names, as INRIA's SIBR viewers do.

They take the count from the header's third line, look for ``end_header`` and read 62 floats per splat: position,
normal, SH of degree 3 (constant, then channel by channel), opacity logit, log scales, quaternion (w first). A comment,
another order, another SH degree or one more column would shift every value.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.export_checks import check_static
from instdrive_core.formats.ply.columns import NORMALS
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

REST = REST_COUNTS[-1]
COLUMNS = (
    *("x", "y", "z", *NORMALS, "f_dc_0", "f_dc_1", "f_dc_2"),
    *(f"f_rest_{index}" for index in range(3 * REST)),
    *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
CHUNK_ROWS = 8192
"""Rows converted at a time: about 2 MB."""


def write_sibr_ply(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment, atomically: plain Gaussians of SH degree 3 and nothing else.

    Lower SH degrees are filled up with zeros, which shows the same picture. Instances, features, other columns, real
    normals and the origin are left out. Raises DataError where the scene has moving actors: place them first
    (`edits.queries.bake.freeze_at_time`).
    """
    check_static(path, scene, ".ply")
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(scene)}"]
    lines += [f"property float {name}" for name in COLUMNS]
    with open_atomically(path) as file:
        file.write("\n".join([*lines, "end_header", ""]).encode("ascii"))
        for start in range(0, len(scene), CHUNK_ROWS):
            file.write(_build_records(scene.gaussians, slice(start, start + CHUNK_ROWS)).data)


def _build_records(gaussians: Gaussians, rows: slice) -> Float32[ndarray, "m 62"]:
    means = gaussians.means[rows]
    coefficients = gaussians.sh_rest.shape[1]
    records = np.zeros((len(means), len(COLUMNS)), "<f4")
    records[:, :3] = means
    records[:, 6:9] = gaussians.sh_dc[rows]
    # Splitting the last axis gives a view, so that what is written here lands in the records.
    by_channel = records[:, 9 : 9 + 3 * REST].reshape(len(means), 3, REST)
    by_channel[:, :, :coefficients] = gaussians.sh_rest[rows].transpose(0, 2, 1)
    records[:, 54] = gaussians.opacity_logits[rows]
    records[:, 55:58] = gaussians.log_scales[rows]
    records[:, 58:] = gaussians.quats[rows]
    return records
