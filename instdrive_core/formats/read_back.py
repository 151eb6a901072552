"""Saving a scene so that nothing takes an old file's place before it was read again and compared."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import copy_context
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import check_before_replacing
from instdrive_core.formats.folder.scenes import MANIFEST, read_scene_folder
from instdrive_core.formats.ply.compressed_layout import CHUNK
from instdrive_core.formats.registry import SIBR, Format, find_format_to_write, save_scene
from instdrive_core.formats.spatial_order import sort_spatially
from instdrive_core.formats.spz.values import choose_fractional_bits
from instdrive_core.progress import report_span
from instdrive_core.scene.scene import Scene

WRITING = 0.6
"""Of the time that writing and reading take together."""
_COMPRESSED_STEPS = np.array([2047, 1023, 2047])
"""Into which a chunk's extent along x, y, z is divided."""
_ROUNDING = 2.0**-22
"""Of float32, relative to the largest coordinate: half a unit in the last place of bounds and of values."""
_ALWAYS_STORED = ("means", "quats", "log_scales", "opacity_logits", "sh_dc")


@dataclass(frozen=True)
class Fidelity:
    """What reading a file again may change of what was written, as docs/formats.md states it."""

    position_error: Callable[[Float[ndarray, "n 3"]], Float[ndarray, "..."] | float]
    """The largest difference (metres, broadcast to the rows) of the positions as they are ordered in the file."""
    order: Callable[[Float[ndarray, "n 3"]], Int64[ndarray, " n"]] | None = None
    """The rows in the file's order, from the positions; None where it is the scene's."""
    is_exact: bool = False
    """Whether all that is stored of a splat comes back bit by bit."""


def _none(means: ndarray) -> float:
    return 0.0


def _half_a_step(means: ndarray) -> float:
    bits = choose_fractional_bits(float(np.abs(means).max(initial=0)))
    return 0.5 ** ((bits or 0) + 1) * (1 + 1e-6)


def _half_a_step_of_chunks(means: ndarray) -> ndarray:
    starts = np.arange(0, len(means), CHUNK)
    values = means.astype(np.float64)
    extents = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
    rounding = _ROUNDING * np.abs(values).max(axis=0)
    return extents[np.arange(len(values)) // CHUNK] / (2 * _COMPRESSED_STEPS) * (1 + 1e-6) + rounding


FIDELITY = {
    "": Fidelity(_none, is_exact=True),
    ".ply": Fidelity(_none, is_exact=True),
    SIBR: Fidelity(_none, is_exact=True),
    ".splat": Fidelity(_none),
    ".spz": Fidelity(_half_a_step),
    ".compressed.ply": Fidelity(_half_a_step_of_chunks, lambda means: sort_spatially(means, CHUNK)),
}
"""By ending; every format that is written has its entry."""


def save_and_verify(path: str | Path, scene: Scene, *, sibr: bool = False) -> None:
    """As `registry.save_scene`, but the written file is read again before it takes its place.

    The count of splats must be the same, every number finite that was, and positions within what the format promises;
    formats without loss must give back the same bits. Where they do not, nothing is replaced and DataError says what
    differs.
    """
    path = Path(path)
    fmt, _ = find_format_to_write(path, sibr)
    around = copy_context()

    def check(temporary: Path, target: Path) -> None:
        # A folder's arrays wait for the manifest that names them.
        if fmt.suffix or target.name == MANIFEST:
            around.run(_check, temporary, path, scene, fmt)

    with report_span(0.0, WRITING), check_before_replacing(check):
        save_scene(path, scene, sibr=sibr)


def _check(temporary: Path, path: Path, scene: Scene, fmt: Format) -> None:
    with report_span(WRITING, 1.0):
        try:
            if fmt.difference is not None:
                wrong = fmt.difference(temporary, scene)
            else:
                found = fmt.read(temporary) if fmt.suffix else read_scene_folder(path, temporary.name)
                wrong = find_loss(scene, found, fmt)
        except (DataError, OSError) as error:
            problem = error.problem if isinstance(error, DataError) else str(error)
            raise _create_refusal(path, f"what was written cannot be read again: {problem}") from error
    if wrong:
        raise _create_refusal(path, f"what was written reads differently: {wrong}")


def _create_refusal(path: Path, problem: str) -> DataError:
    remedy = "Nothing was replaced. Check the disk and try again, or choose another format"
    return DataError(path, problem, remedy)


def find_loss(written: Scene, found: Scene, fmt: Format) -> str:
    """What a file of this format, read as `found`, has lost beyond its promise; empty where nothing is."""
    if len(found) != len(written):
        return f"{len(found):,} splats came back of {len(written):,}"
    if not len(written):
        return ""
    fidelity = FIDELITY[fmt.suffix]
    if fidelity.is_exact:
        return _find_changed_bits(written, found, fmt)
    order = None if fidelity.order is None else fidelity.order(written.gaussians.means)
    return _find_moved(written, found, fidelity, order) or _find_no_longer_finite(written, found, order)


def _find_changed_bits(written: Scene, found: Scene, fmt: Format) -> str:
    pairs = {name: (getattr(written.gaussians, name), getattr(found.gaussians, name)) for name in _ALWAYS_STORED}
    rest, found_rest = written.gaussians.sh_rest, found.gaussians.sh_rest
    pairs["sh_rest"] = (rest, found_rest[:, : rest.shape[1]])
    if fmt.suffix != SIBR:
        pairs["features"] = (written.gaussians.features, found.gaussians.features)
        if len(written.table) or written.code_bits:
            pairs["instance_ids"] = (written.instance_ids, found.instance_ids)
    for name, (before, after) in pairs.items():
        if before.shape != after.shape:
            return f"{name} has shape {after.shape}, not {before.shape}"
        # As integers: NaN is kept and must count as equal.
        changed = np.ascontiguousarray(before).view(np.uint32) != np.ascontiguousarray(after).view(np.uint32)
        if changed.any():
            place = tuple(np.argwhere(changed)[0].tolist())
            return f"{name} of splat {place[0]:,} is {after[place]:.9g}, not {before[place]:.9g}"
    return ""


def _find_moved(written: Scene, found: Scene, fidelity: Fidelity, order: ndarray | None) -> str:
    before = written.gaussians.means if order is None else written.gaussians.means[order]
    after = found.gaussians.means
    with np.errstate(invalid="ignore"):  # what was no number may stay so
        apart = np.abs(after.astype(np.float64) - before)
    allowed = np.broadcast_to(fidelity.position_error(before), before.shape)
    far = ~(apart <= allowed) & np.isfinite(before)
    if not far.any():
        return ""
    row, axis = np.argwhere(far)[0].tolist()
    splat = row if order is None else int(order[row])
    return (
        f"{'xyz'[axis]} of splat {splat:,} is {after[row, axis]:.9g} m, not {before[row, axis]:.9g} m, "
        f"{apart[row, axis]:.3g} m off where {allowed[row, axis]:.3g} m are allowed"
    )


def _find_no_longer_finite(written: Scene, found: Scene, order: ndarray | None) -> str:
    for name in (*_ALWAYS_STORED, "sh_rest"):
        before, after = getattr(written.gaussians, name), getattr(found.gaussians, name)
        damaged = ~np.isfinite(after)
        if damaged.any():
            rows = np.flatnonzero(damaged.reshape(len(damaged), -1).any(axis=1))
            sources = rows if order is None else order[rows]
            lost = np.isfinite(before[sources]).reshape(len(rows), -1).all(axis=1)
            if lost.any():
                return f"{name} of splat {int(sources[lost][0]):,} is not finite"
    return ""
