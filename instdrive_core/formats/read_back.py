"""Saving a scene so that nothing replaces an old file before it was read again and compared."""

from __future__ import annotations

from contextvars import copy_context
from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import check_before_replacing
from instdrive_core.formats.registry import find_format_to_write, save_scene
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.progress import report_span
from instdrive_core.scene.scene import Scene

WRITING = 0.6
"""Share of writing in the time that writing and reading take together."""
_ALWAYS_STORED = ("means", "quats", "log_scales", "opacity_logits", "sh_dc")


def save_and_verify(path: str | Path, scene: Scene, *, sibr: bool = False) -> None:
    """Save a scene by its path's ending, and read the written file again before it takes its place.

    The count of splats must be the same, every number finite that was, and positions within what the format promises;
    formats without loss must give back the same bits. Where they do not, nothing is replaced and DataError says what
    differs.
    """
    path = Path(path)
    fmt, _ = find_format_to_write(path, sibr)
    around = copy_context()

    def check(temporary: Path, target: Path) -> None:
        # A folder's arrays wait for the file that names them, and what stands beside a file is no scene.
        last = fmt.folder.last_file if fmt.folder is not None and not fmt.suffix else path.resolve().name
        if target.name == last:
            around.run(_check, temporary, path, scene, fmt)

    with report_span(0.0, WRITING), check_before_replacing(check):
        save_scene(path, scene, sibr=sibr)


def _check(temporary: Path, path: Path, scene: Scene, fmt: Format) -> None:
    with report_span(WRITING, 1.0):
        try:
            fidelity = fmt.fidelity or Fidelity()
            if fidelity.find_change is not None:
                wrong = fidelity.find_change(temporary, scene)
            else:
                wrong = find_loss(scene, fmt.read(temporary), fidelity)
        except (DataError, OSError) as error:
            problem = error.problem if isinstance(error, DataError) else str(error)
            raise _create_refusal(path, f"what was written cannot be read again: {problem}") from error
    if wrong:
        raise _create_refusal(path, f"what was written reads differently: {wrong}")


def _create_refusal(path: Path, problem: str) -> DataError:
    remedy = "Nothing was replaced. Check the disk and try again, or choose another format"
    return DataError(path, problem, remedy)


def find_loss(written: Scene, found: Scene, fidelity: Fidelity) -> str:
    """What a file, read as `found`, has lost beyond what its format allows; empty where nothing is."""
    if len(found) != len(written):
        return f"{len(found):,} splats came back of {len(written):,}"
    if not len(written):
        return ""
    if fidelity.is_exact:
        return _find_changed_bits(written, found, fidelity.keeps_instances)
    order = fidelity.find_order(written)
    return _find_moved(written, found, fidelity, order) or _find_no_longer_finite(written, found, order)


def _find_changed_bits(written: Scene, found: Scene, keeps_instances: bool) -> str:
    pairs = {name: (getattr(written.gaussians, name), getattr(found.gaussians, name)) for name in _ALWAYS_STORED}
    rest, found_rest = written.gaussians.sh_rest, found.gaussians.sh_rest
    pairs["sh_rest"] = (rest, found_rest[:, : rest.shape[1]])
    if keeps_instances:
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
