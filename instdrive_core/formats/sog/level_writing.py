"""Writing a SOG scene in levels of detail, the streamed layout that `levels` reads: viewers load what they need.

Space is halved until a place holds few splats. Each level keeps every fourth splat of a place that the level before
it kept, in spatial order, and makes them larger, as opening every fourth splat does.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

from instdrive_core.files.atomic import write_bytes
from instdrive_core.formats.allocation import enlarge_splats
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.sog.levels import LOD_META
from instdrive_core.formats.sog.scenes import META
from instdrive_core.formats.sog.writing import check_for_sog, order_for_sog, pack_sog, save_sog_files
from instdrive_core.progress import report, report_span
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

LEVELS, STEP = 4, 4
"""Levels of detail, and how many splats of one stand for a splat of the next."""
PLACE, FILE = 16_384, 524_288
"""The most splats of the finest level in one place, and about how many of a level share a file."""
_OURS = re.compile(r"levels-[0-9a-f]{16}")
_SIGMAS = 3.0
"""Bounds of a place reach this many standard deviations around its splats."""


@dataclass
class _Level:
    """Rows of one level, file by file, as the tree refers to them."""

    files: list[list[Int64[ndarray, " k"]]]

    def add(self, rows: Int64[ndarray, " k"]) -> tuple[int, int]:
        """Add the rows of a place; returns the number of their file within the level and the place in it."""
        if not self.files or sum(map(len, self.files[-1])) >= FILE:
            self.files.append([])
        start = sum(map(len, self.files[-1]))
        self.files[-1].append(rows)
        return len(self.files) - 1, start


def write_sog_levels(path: str | Path, scene: Scene) -> None:
    """Write a lod-meta.json, atomically and last, and a folder of all levels beside it, under a name of its own.

    What an earlier scene of the same lod-meta.json left in such a folder is removed afterwards. Raises DataError where
    `write_sog` does.
    """
    path = Path(path)
    check_for_sog(path, scene, LOD_META)
    means = scene.gaussians.means
    levels = [_Level([]) for _ in range(LEVELS)]
    places, tree = _build_tree(_split_space(means), scene.gaussians)
    entries: list[tuple[dict[str, Any], int]] = []
    for leaf, rows in places:
        for number, level in enumerate(levels):
            kept = rows[:: STEP**number]
            file, start = level.add(kept)
            leaf["lods"][str(number)] = entry = {"file": file, "offset": start, "count": len(kept)}
            entries.append((entry, number))
    firsts = np.cumsum([0, *(len(level.files) for level in levels)])
    for entry, number in entries:
        entry["file"] += int(firsts[number])
    _write_files(path, scene, levels, tree)


def order_for_levels(means: Float[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
    """Row numbers in the order of the finest level."""
    return np.concatenate(_list_places(_split_space(means)))


def _split_space(means: Float[ndarray, "n 3"]) -> Any:
    """Halve rows at the median of the axis they spread along most: nested pairs, with the rows of places inside."""

    def split(rows: ndarray) -> Any:
        if len(rows) <= PLACE:
            return rows[order_for_sog(means[rows])]
        inside = means[rows]
        axis = int(np.argmax(np.ptp(inside, axis=0)))
        order = rows[np.argsort(inside[:, axis], kind="stable")]
        return split(order[: len(order) // 2]), split(order[len(order) // 2 :])

    return split(np.arange(len(means)))


def _list_places(split: Any) -> list[Int64[ndarray, " k"]]:
    return [rows for half in split for rows in _list_places(half)] if isinstance(split, tuple) else [split]


def _build_tree(split: Any, gaussians: Gaussians) -> tuple[list[tuple[dict[str, Any], ndarray]], dict[str, Any]]:
    """Build the nodes of a split; returns the leaves with their rows, from first to last, and the root."""
    if isinstance(split, tuple):
        (first, left), (second, right) = (_build_tree(half, gaussians) for half in split)
        bounds = [left["bound"], right["bound"]]
        low = np.min([bound["min"] for bound in bounds], axis=0).tolist()
        high = np.max([bound["max"] for bound in bounds], axis=0).tolist()
        return first + second, {"bound": {"min": low, "max": high}, "children": [left, right]}
    means = gaussians.means[split].astype(np.float64)
    reach = _SIGMAS * np.exp(np.clip(gaussians.log_scales[split], -87, 60).max(axis=1, keepdims=True))
    bound = {"min": (means - reach).min(axis=0).tolist(), "max": (means + reach).max(axis=0).tolist()}
    leaf = {"bound": bound, "lods": {}}
    return [(leaf, split)], leaf


def _write_files(path: Path, scene: Scene, levels: list[_Level], tree: dict[str, Any]) -> None:
    units = [(number, index, np.concatenate(rows)) for number, level in enumerate(levels)
             for index, rows in enumerate(level.files)]  # fmt: skip
    counts = [sum(len(rows) for number, _, rows in units if number == level) for level in range(LEVELS)]
    packed: dict[str, dict[str, bytes]] = {}
    digest = hashlib.sha256()
    done, total = 0, sum(counts)
    for number, index, rows in units:
        with report_span(0.95 * done / total, 0.95 * (done + len(rows)) / total):
            chosen = scene.gaussians.select(rows)
            if number:
                enlarge_splats(chosen.log_scales, STEP**number)
            files = pack_sog(chosen, scene.antialiased)
        check_plausible_count(path, len(rows), sum(map(len, files.values())))
        for data in files.values():
            digest.update(data)
        packed[f"{number}_{index}"] = files
        done += len(rows)
    folder = f"levels-{digest.hexdigest()[:16]}"
    content = {
        "version": 1,
        "count": total,
        "counts": counts,
        "lodLevels": LEVELS,
        "filenames": [f"{folder}/{name}/{META}" for name in packed],
        "tree": tree,
    }
    is_new = not (path.parent / folder).exists()
    try:
        for name, files in packed.items():
            save_sog_files(path.parent / folder / name / META, files)
        write_bytes(path, json.dumps(content).encode())
    except BaseException:
        if is_new:
            shutil.rmtree(path.parent / folder, ignore_errors=True)
        raise
    report(1.0)
    for other in path.parent.iterdir():
        if _OURS.fullmatch(other.name) and other.name != folder and other.is_dir() and not other.is_symlink():
            shutil.rmtree(other)
