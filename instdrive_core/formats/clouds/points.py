"""A cloud's points as splats: as large as the gaps between neighbours, coloured as they are or by their intensity."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import ReadOptions, allocate_gaussians
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.progress import report
from instdrive_core.scene.scene import Scene, scene_from_gaussians

PASSING = 150
"""Bytes per point that are needed while a cloud is read: positions, colours, and the tree that finds neighbours."""
_NEIGHBOURS = 3
_SHARE_OF_GAP = 0.4
"""Standard deviation of a splat, by the mean gap to its neighbours: surfaces close without blurring."""
_SMALLEST, _LARGEST = 0.002, 0.25
"""Metres: standard deviations of splats."""
_OPACITY = 0.95
_FARTHEST = 1e30
"""Metres: what is farther is no position; float32 ends soon after."""
_FAR = 1e5
"""Metres from the origin beyond which float32 is no longer good to a centimetre."""
_BLOCK_ROWS = 1 << 18
_GREY = 0.5


@dataclass(frozen=True)
class CloudPoints:
    """Points as their file has them."""

    positions: Float64[ndarray, "n 3"]
    """Metres."""
    colors: UInt8[ndarray, "n 3"] | None = None
    intensities: Float[ndarray, " n"] | None = None
    """Any scale will do."""
    extra: dict[str, ndarray] = field(default_factory=dict)
    """Columns that are kept, such as the classes of a .las."""


def make_cloud_scene(path: Path, cloud: CloudPoints, options: ReadOptions) -> Scene:
    """Make a scene of a cloud; its origin is moved near to it where it lies far away (UTM).

    Raises DataError where no point is left, SceneTooLargeError.
    """
    with np.errstate(invalid="ignore"):
        good = np.asarray((np.abs(cloud.positions) < _FARTHEST).all(axis=1))
    left_out = () if good.all() else (f"{int((~good).sum()):,} points without a position",)
    if not good.any():
        raise DataError(path, "the cloud has no points with a position", "Export it again")
    positions = cloud.positions[good]
    origin = np.zeros(3)
    if np.abs(positions).max() > _FAR:
        origin = np.floor(np.median(positions, axis=0))
    local = (positions - origin).astype(np.float32)
    gaussians = allocate_gaussians(path, len(local), 0, 0, options)
    kept = slice(None, None, options.keep_every)
    gaussians.means[:] = local[kept]
    gaussians.log_scales[:] = np.log(_measure_gaps(local)[kept, None] * _SHARE_OF_GAP)
    gaussians.quats[:] = [1, 0, 0, 0]
    gaussians.opacity_logits[:] = logit(np.array([_OPACITY]))
    gaussians.sh_dc[:] = dc_from_color(_choose_colors(cloud, good)[kept])
    scene = scene_from_gaussians(gaussians)
    scene.origin = origin
    scene.extra = {name: column[good][kept] for name, column in cloud.extra.items()}
    scene.left_out = left_out
    return scene


def _measure_gaps(points: Float[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
    """Measure the mean distance to the nearest neighbours, inside what a splat's size may be."""
    tree, gaps = KDTree(points), np.full(len(points), _SMALLEST / _SHARE_OF_GAP)
    count = min(_NEIGHBOURS, len(points) - 1)
    for start in range(0, len(points) if count else 0, _BLOCK_ROWS):
        rows = slice(start, start + _BLOCK_ROWS)
        distances, _ = tree.query(points[rows], count + 1, workers=-1)
        gaps[rows] = distances[:, 1:].mean(axis=1)
        report(min(1.0, (start + _BLOCK_ROWS) / len(points)))
    return np.clip(gaps, _SMALLEST / _SHARE_OF_GAP, _LARGEST / _SHARE_OF_GAP)


def _choose_colors(cloud: CloudPoints, good: ndarray) -> Float64[ndarray, "n 3"]:
    """Choose colours in [0, 1]: the points' own, greys by intensity, or one grey."""
    if cloud.colors is not None:
        return cloud.colors[good] / 255.0
    greys = np.full(int(good.sum()), _GREY)
    if cloud.intensities is not None:
        values = np.nan_to_num(cloud.intensities[good].astype(np.float64), posinf=0.0, neginf=0.0)
        low, high = np.percentile(values, [2, 98])
        if high > low:
            greys = np.clip((values - low) / (high - low), 0, 1)
    return np.repeat(greys[:, None], 3, axis=1)
