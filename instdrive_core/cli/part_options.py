"""What ``instdrive apply`` writes besides, or instead of, the whole scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Int
from numpy import ndarray

from instdrive_core.cli.arguments import check_known_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.scene_parts import find_remaining_actors
from instdrive_core.errors import OptionError
from instdrive_core.project.export import ExportedParts, export_actors, export_instances
from instdrive_core.wording import format_count

DEFAULT_ENDING = ".ply"


@dataclass(frozen=True)
class PartOptions:
    """Done after all edits."""

    only: tuple[int, ...] = ()
    """IDs of the instances that are exported; everything else, and the sky, is left out of --out and --each."""
    each: Path | None = None
    """Folder to write each instance into as a file of its own, with a listing, instances.json; in --out's format."""
    actors: Path | None = None
    """Folder to write each moving object into, in its own frame, with its poses as JSON; in --out's format."""

    def rows(self, document: Document) -> Int[ndarray, " k"] | None:
        """The splats of --only; None for all. Raises OptionError for an unknown ID."""
        return document.find_rows(check_known_ids(self.only, document.scene.table)) if self.only else None

    def write(self, document: Document, time: float, ending: str, sibr: bool) -> None:
        """Write --each and --actors; `ending` is that of the scene's file, empty for a folder."""
        ending = ending or DEFAULT_ENDING
        if self.each is not None:
            counts = document.count_states()
            ids = self.only or tuple(counts.ids[counts.count > counts.deleted].tolist())
            _require(ids, "the scene has no instances, so --each has nothing to write; train it with masks first")
            written = export_instances(document, self.each, ids, time, ending, sibr=sibr)
            absent = f" ({written.skipped} are not there at {time:g} s)" if written.skipped else ""
            print(f"{self.each}: {_describe_parts(written)}{absent}")
        if self.actors is not None:
            nodes = find_remaining_actors(document)
            _require(nodes, "the scene has no moving objects, so --actors has nothing to write")
            written = export_actors(document, self.actors, nodes, ending, sibr=sibr)
            print(f"{self.actors}: {_describe_parts(written)}, with poses")


def _require(found: Iterable[int], problem: str) -> None:
    if not tuple(found):
        raise OptionError(problem)


def _describe_parts(written: ExportedParts) -> str:
    return f"{format_count(len(written.files), 'file')}, {format_count(written.splats, 'splat')}"
