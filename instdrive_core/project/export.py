"""Exporting an edited scene, or parts of it, into files that were read again before they took their places."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.scene_parts import bake_actor, bake_part
from instdrive_core.errors import DataError, InstDriveError, OptionError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.formats.objects.poses import write_poses
from instdrive_core.formats.read_back import save_and_verify
from instdrive_core.progress import CancelledError, report_span
from instdrive_core.scene.camera import Camera

BAKING = 0.25
"""Baking's share of the time that baking and saving take together."""
LISTING = "instances.json"
"""Written last, so that a folder without it is unfinished."""
POSES_SUFFIX = ".poses.json"
_NAME_LENGTH = 40


@dataclass(frozen=True)
class ExportedParts:
    """Files that were written into a folder."""

    files: tuple[Path, ...]
    """Files of splats."""
    splats: int
    skipped: int
    """Instances of which nothing is there at the time."""


def export_scene(
    document: Document,
    path: Path,
    time: float | None,
    rows: Int[ndarray, " k"] | None = None,
    *,
    sibr: bool = False,
    start: Camera | None = None,
) -> int:
    """Write the edited scene, or some of its splats (rising rows) without sky; returns how many splats.

    Args:
        document: unchanged meanwhile.
        path: its ending says the format.
        time: seconds at which actors are placed; None keeps their tracks, which only a folder can.
        rows: None for all.
        sibr: as in `registry.save_scene`.
        start: where the user looks from; a .ply keeps it, with the sky.

    Raises DataError; what was at `path` is then still there, and whole.
    """
    with report_span(0.0, BAKING):
        scene = bake_document(document, time, to_read=True) if rows is None else bake_part(document, rows, time)
        scene = replace(scene, start=start)
    if rows is not None and not len(scene):
        raise OptionError(f"nothing of what is selected is there at {time:g} s; choose another time step")
    with report_span(BAKING, 1.0):
        save_and_verify(path, scene, sibr=sibr)
    return len(scene)


def export_instances(
    document: Document, folder: Path, ids: Iterable[int], time: float, suffix: str, *, sibr: bool = False
) -> ExportedParts:
    """Write each instance as a file of its own, ``ID_name`` and the ending, and a listing of them.

    Args:
        document: unchanged meanwhile.
        folder: made where missing; files of the same names are replaced.
        ids: known ones; of which nothing is there at the time is skipped.
        time: seconds at which actors are placed.
        suffix: of a format for files.
        sibr: as in `registry.save_scene`.

    Raises DataError, which tells how many files were written before.
    """
    table, listed = document.scene.table, []

    def write(number: int) -> tuple[Path, int] | None:
        instance = table[number]
        part = bake_part(document, document.find_rows((number,)), time)
        if not len(part):
            return None
        path = folder / f"{number:04d}_{make_file_name(instance.name)}{suffix}"
        save_and_verify(path, part, sibr=sibr)
        fields = {"id": number, "name": instance.name, "class": instance.class_name, "codeword": instance.codeword}
        listed.append({"file": path.name, **fields, "count": len(part)})
        return path, len(part)

    _remove_listing(folder)
    written = _write_each(folder, tuple(ids), write)
    _write_listing(folder, {"time": time, "origin": document.scene.origin.tolist(), "instances": listed})
    return written


def export_actors(
    document: Document, folder: Path, nodes: Iterable[int], suffix: str, *, sibr: bool = False
) -> ExportedParts:
    """Write actors in their boxes' frames, ``NUMBER_label`` and the ending, each with its poses as JSON beside.

    Args as for `export_instances`; `nodes` count from 1. Raises DataError, which tells how many files were written
    before, and EditError for an actor that is not there.
    """
    scene = document.scene

    def write(node: int) -> tuple[Path, int]:
        track, part = scene.actors[node - 1], bake_actor(document, node)
        stem = f"{node:03d}_{make_file_name(track.label)}"
        path = folder / f"{stem}{suffix}"
        save_and_verify(path, part, sibr=sibr)
        write_poses(folder / f"{stem}{POSES_SUFFIX}", track, scene.origin, path.name)
        return path, len(part)

    return _write_each(folder, tuple(nodes), write)


def make_file_name(text: str) -> str:
    """Letters, digits, hyphens and underscores of a name that users may have typed."""
    return re.sub(r"[^\w-]+", "_", text).strip("_")[:_NAME_LENGTH] or "unnamed"


def _write_each(folder: Path, numbers: Sequence[int], write: Callable[[int], tuple[Path, int] | None]) -> ExportedParts:
    if folder.exists() and not folder.is_dir():
        raise DataError(folder, "this is a file, and many files are to be written", "Give the name of a folder")
    written: list[tuple[Path, int]] = []
    for place, number in enumerate(numbers):
        try:
            with report_span(place / len(numbers), (place + 1) / len(numbers)):
                done = write(number)
        except CancelledError:
            raise
        except InstDriveError as error:
            written_before = f"{len(written)} of {len(numbers)} files were written before"
            if isinstance(error, DataError):
                raise DataError(error.path, f"{error.problem}; {written_before}", error.remedy) from error
            raise
        if done is not None:
            written.append(done)
    return ExportedParts(
        tuple(path for path, _ in written), sum(count for _, count in written), len(numbers) - len(written)
    )


def _remove_listing(folder: Path) -> None:
    try:
        if folder.is_dir():
            (folder / LISTING).unlink(missing_ok=True)
    except OSError as error:
        problem = f"the listing of an earlier export cannot be replaced ({error.strerror or error})"
        raise DataError(folder / LISTING, problem, "Choose a folder that can be written") from error


def _write_listing(folder: Path, content: dict[str, Any]) -> None:
    write_bytes(folder / LISTING, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode())
