"""Defects of a scene's splats: values that break programs, and splats that nobody will ever see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int64, UInt64
from numpy import ndarray

from instdrive_core.maths.extent import CORE_SHARE, Extent, measure_extent
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import Phrase, count_phrase, phrase

DefectKind = Literal[
    "not_finite", "zero_quaternion", "giant_scale", "far_outlier", "never_shown", "duplicate", "empty_sh"
]

HARMFUL: tuple[DefectKind, ...] = ("not_finite", "zero_quaternion", "giant_scale", "far_outlier")
"""Kinds that show, or break programs; the others only waste memory."""

VISIBLE_OPACITY = 1 / 255
"""Rasterizers pass over what covers less than one step of an 8-bit picture (Kerbl et al. 2023)."""
SHORTEST_QUATERNION = 1e-6
"""Shorter ones are as good as zero: float32 squares lose their digits, and the direction is noise."""
FAR_RADII = 20.0
"""A splat this many radii away is an outlier; distant buildings and hills of a drive are nearer."""
CHUNK_ROWS = 65536


@dataclass(frozen=True)
class Defect:
    """All splats with one kind of defect."""

    kind: DefectKind
    what: str
    """A sentence with its figures, without a full stop."""
    count: int
    """How many splats; for `empty_sh`, how many coefficients per splat."""
    rows: Int64[ndarray, " m"]
    """The splats, ascending; none where all are concerned (`empty_sh`)."""
    remedy: str


def find_defects(scene: Scene) -> tuple[Defect, ...]:
    """Find the defects of a scene, the most harmful first; nothing is changed.

    Infinite opacity logits are opacities of exactly 0 or 1 and are no fault. Extents are measured on the background
    only: actors lie in frames of their own.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        means = scene.gaussians.means
        extent = measure_extent(means, np.flatnonzero((scene.nodes == 0) & ~_find_rows_not_finite(means)))
        findings = (
            _find_not_finite(scene),
            _find_zero_quaternions(scene),
            _find_giant_scales(scene, extent),
            _find_far_outliers(scene, extent),
            _find_never_shown(scene),
            _find_duplicates(scene),
            _find_empty_sh(scene),
        )
    return tuple(finding for finding in findings if finding is not None)


def _create_defect(
    kind: DefectKind, wrong: Bool[ndarray, " n"], describe: Callable[[int], Phrase], remedy: str
) -> Defect | None:
    """`describe` says of a number of splats what is wrong with them."""
    rows = np.flatnonzero(wrong)
    return Defect(kind, describe(len(rows)), len(rows), rows, remedy) if len(rows) else None


def _find_not_finite(scene: Scene) -> Defect | None:
    wrong, parts = np.zeros(len(scene), bool), []
    for name, values in scene.gaussians.arrays().items():
        broken = np.isnan(values) if name == "opacity_logits" else _find_rows_not_finite(values)
        if broken.any():
            parts.append(f"{name} of {np.count_nonzero(broken):,}")
            wrong |= broken

    def describe(count: int) -> Phrase:
        return count_phrase(
            count,
            "{count:,} splat holds values that are not finite ({parts})",
            "{count:,} splats hold values that are not finite ({parts})",
            parts=", ".join(parts),
        )

    remedy = phrase("Best deleted: most viewers draw nothing or fail where one is in view")
    return _create_defect("not_finite", wrong, describe, remedy)


def _find_rows_not_finite(values: ndarray) -> Bool[ndarray, " n"]:
    """Rows with NaN or infinity; chunk by chunk, as a mask of all SH coefficients would be as large as the scene."""
    wrong = np.zeros(len(values), bool)
    flat = _flatten_rows(values)
    for start in range(0, len(flat), CHUNK_ROWS):
        finite = np.isfinite(flat[start : start + CHUNK_ROWS])
        if not finite.all():
            wrong[start : start + CHUNK_ROWS] = ~finite.all(axis=1)
    return wrong


def _flatten_rows(values: ndarray) -> ndarray:
    """One row per splat, also where there is none, which leaves -1 undefined."""
    return values.reshape(len(values), int(np.prod(values.shape[1:])))


def _find_zero_quaternions(scene: Scene) -> Defect | None:
    quats = scene.gaussians.quats
    squares = np.einsum("ni,ni->n", quats, quats)

    def describe(count: int) -> Phrase:
        return count_phrase(
            count, "{count:,} splat has a rotation of length 0", "{count:,} splats have a rotation of length 0"
        )

    remedy = phrase("Best deleted, or set to 1 0 0 0: programs that normalise rotations get NaN")
    return _create_defect("zero_quaternion", squares < SHORTEST_QUATERNION**2, describe, remedy)


def _find_giant_scales(scene: Scene, extent: Extent | None) -> Defect | None:
    if extent is None:
        return None
    longest = scene.gaussians.log_scales.max(axis=1)
    wrong = np.isfinite(longest) & (longest > np.log(extent.radius))

    def describe(count: int) -> Phrase:
        return count_phrase(
            count,
            "{count:,} splat is larger than the scene (standard deviation above {radius:.3g} m)",
            "{count:,} splats are larger than the scene (standard deviation above {radius:.3g} m)",
            radius=extent.radius,
        )

    remedy = phrase("Best deleted where the view is veiled; sky belongs into a sky map")
    return _create_defect("giant_scale", wrong, describe, remedy)


def _find_far_outliers(scene: Scene, extent: Extent | None) -> Defect | None:
    if extent is None:
        return None
    limit = FAR_RADII * extent.radius
    wrong = np.zeros(len(scene), bool)
    wrong[extent.rows] = extent.distances > limit

    def describe(count: int) -> Phrase:
        return count_phrase(
            count,
            "{count:,} splat lies more than {limit:.3g} m from the middle; "
            "{share:.0%} of all are within {radius:.3g} m",
            "{count:,} splats lie more than {limit:.3g} m from the middle; "
            "{share:.0%} of all are within {radius:.3g} m",
            limit=limit,
            share=CORE_SHARE,
            radius=extent.radius,
        )

    remedy = phrase("Best deleted: framing, bounds and quantised formats suffer")
    return _create_defect("far_outlier", wrong, describe, remedy)


def _find_never_shown(scene: Scene) -> Defect | None:
    # logit(1/255): comparing logits spares a million exponentials.
    limit = np.float32(np.log(VISIBLE_OPACITY / (1 - VISIBLE_OPACITY)))
    wrong = scene.gaussians.opacity_logits < limit

    def describe(count: int) -> Phrase:
        return count_phrase(
            count,
            "{count:,} splat has an opacity below 1/255, too faint to show",
            "{count:,} splats have an opacity below 1/255, too faint to show",
        )

    return _create_defect("never_shown", wrong, describe, phrase("Deleting saves memory"))


def _find_duplicates(scene: Scene) -> Defect | None:
    """Splats of the same place, shape, opacity and base colour, bit by bit, as an earlier one."""
    gaussians = scene.gaussians
    names = ("means", "quats", "log_scales", "opacity_logits", "sh_dc")
    words = [_flatten_rows(getattr(gaussians, name)).view(np.uint32) for name in names]
    words.append(scene.nodes.astype(np.uint32)[:, None])
    hashes = _hash_rows(words)
    ordered = np.sort(hashes)
    if not (ordered[1:] == ordered[:-1]).any():
        return None
    # Stable, so that the first of equal splats is the one that stays.
    order = np.argsort(hashes, kind="stable")
    pairs = np.flatnonzero(hashes[order[1:]] == hashes[order[:-1]])
    later, earlier = order[pairs + 1], order[pairs]
    same = np.ones(len(pairs), bool)
    for part in words:
        same &= (part[later] == part[earlier]).all(axis=1)
    wrong = np.zeros(len(scene), bool)
    wrong[later[same]] = True

    def describe(count: int) -> Phrase:
        return count_phrase(
            count, "{count:,} splat repeats an earlier one exactly", "{count:,} splats repeat an earlier one exactly"
        )

    return _create_defect("duplicate", wrong, describe, phrase("Best deleted: the picture gets too opaque"))


def _hash_rows(parts: list[ndarray]) -> UInt64[ndarray, " n"]:
    """One number per row of 32-bit words: multiply and add, with a shift that carries high bits down (splitmix)."""
    hashes = np.zeros(len(parts[0]), np.uint64)
    for part in parts:
        for column in part.T:
            hashes += column
            hashes *= np.uint64(0x9E3779B97F4A7C15)
            hashes ^= hashes >> np.uint64(29)
    return hashes


def _find_empty_sh(scene: Scene) -> Defect | None:
    """SH columns above the degree that the scene makes use of."""
    rest = scene.gaussians.sh_rest
    if not rest.size:
        return None
    used = np.zeros(rest.shape[1], bool)
    for start in range(0, len(rest), CHUNK_ROWS):
        used |= rest[start : start + CHUNK_ROWS].any(axis=(0, 2))
        if used[-1]:
            break
    needed = int(np.max(np.flatnonzero(used), initial=-1)) + 1
    degree = next(degree for degree, count in enumerate(REST_COUNTS) if count >= needed)
    empty = rest.shape[1] - REST_COUNTS[degree]
    if not empty:
        return None
    what = phrase(
        "{empty} of {all} SH coefficients are zero in every splat (degree {degree} would do)",
        empty=empty,
        all=rest.shape[1],
        degree=degree,
    )
    remedy = phrase("Nothing is wrong; the file is larger than needed")
    return Defect("empty_sh", what, empty, np.zeros(0, np.int64), remedy)
