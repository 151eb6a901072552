"""One brightness and tint for all pieces: each piece took the mean of its own photos for neutral.

A photo that two pieces were trained on shows E_a · colour in the one and E_b · colour in the other; so E_a⁻¹ E_b takes
the colours of one to those of the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky


def align_colors(exposures: Sequence[Exposures | None]) -> list[Float64[ndarray, "4 4"]]:
    """Find the affine change of each piece's colours that makes all pieces agree.

    Args:
        exposures: of the pieces in order; neighbours share photos.

    Without exposures, or where neighbours share no photo, nothing is changed between them. All together stay as
    bright as they are in the mean.
    """
    changes = [np.eye(4)]
    for before, after in pairwise(exposures):
        changes.append(changes[-1] @ _compare_exposures(before, after))
    mean = np.mean(changes, axis=0)
    return [np.linalg.solve(mean, change) for change in changes]


def change_colors(scene: Scene, change: Float64[ndarray, "4 4"]) -> Scene:
    """Copy a scene with other colours whose photos look as before: exposures undo the change."""
    if np.array_equal(change, np.eye(4)):
        return scene
    gaussians, turn, shift = scene.gaussians, change[:3, :3], change[:3, 3]
    colors = color_from_dc(gaussians.sh_dc) @ turn.T + shift
    exposures = scene.exposures
    if exposures is not None:
        back = _expand(exposures) @ np.linalg.inv(change)
        exposures = replace(exposures, matrices=back[:, :3].astype(np.float32))
    return replace(
        scene,
        gaussians=replace(
            gaussians,
            sh_dc=dc_from_color(colors).astype(np.float32),
            sh_rest=(gaussians.sh_rest @ turn.T).astype(np.float32),
        ),
        sky=None if scene.sky is None else Sky((scene.sky.faces @ turn.T + shift).clip(0, 1).astype(np.float32)),
        exposures=exposures,
    )


def join_exposures(parts: Sequence[Exposures | None], owned: Sequence[frozenset[str]]) -> Exposures | None:
    """Join the exposures of pieces, each photo's from the piece that owns its key; None where no piece has any."""
    keys: list[str] = []
    times, matrices = [], []
    for part, mine in zip(parts, owned, strict=True):
        for row, key in enumerate(part.keys if part is not None else ()):
            if part is not None and key in mine:
                keys.append(key)
                times.append(part.times[row])
                matrices.append(part.matrices[row])
    if not keys:
        return None
    return Exposures(tuple(keys), np.array(times, np.float64), np.array(matrices, np.float32))


def _compare_exposures(before: Exposures | None, after: Exposures | None) -> Float64[ndarray, "4 4"]:
    """Mean change that takes colours of the second to those of the first."""
    if before is None or after is None:
        return np.eye(4)
    shared = [key for key in after.keys if key in set(before.keys)]
    if not shared:
        return np.eye(4)
    first = _expand(before)[[before.keys.index(key) for key in shared]]
    second = _expand(after)[[after.keys.index(key) for key in shared]]
    return np.median(np.linalg.solve(first, second), axis=0)


def _expand(exposures: Exposures) -> Float64[ndarray, "v 4 4"]:
    matrices = np.tile(np.eye(4), (len(exposures.keys), 1, 1))
    matrices[:, :3] = exposures.matrices
    return matrices
