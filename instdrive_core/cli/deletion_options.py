"""What ``instdrive apply`` tells of deletions, and does about what they leave."""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import dataclass

from instdrive_core.edits.deletions.deletion_report import DeletionReport, report_deletion
from instdrive_core.edits.deletions.prepared_fill import prepare_useful
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.errors import EditError, OptionError


@dataclass(frozen=True)
class DeletionOptions:
    """Done after all other edits, for all instances that were deleted together."""

    report: bool = False
    """Print what deletions leave: residue (strays of what was deleted) and holes (ground that no photo showed)."""
    absorb_residue: bool = False
    """Delete the residue of deletions, too."""
    fill_holes: bool = False
    """Clone ground from around into the holes that deletions leave; the copies are marked as synthetic."""

    def follow(self, document: Document, edits: Iterable[Edit], gone_before: Set[int], time: float) -> None:
        """Report on what `edits` deleted and clean up after it; `time` in seconds.

        Args:
            gone_before: IDs that `find_gone` gave before the edits.

        Raises:
            OptionError: nothing was deleted.
        """
        if not (self.report or self.absorb_residue or self.fill_holes):
            return
        table = document.scene.table
        named = {number for edit in edits if isinstance(edit, DeleteInstances) for number in edit.ids}
        ids = {number for number in named if number in table} | (find_gone(document) - gone_before)
        if not ids:
            raise OptionError(
                "nothing was deleted, so nothing can be left of it; say what with --delete or --delete-class"
            )
        found = report_deletion(document, ids, time)
        if self.report:
            print("\n".join(_describe_deletion(found, document)))
        cleanup = found.make_absorb_edit() if self.absorb_residue else None
        if cleanup is not None:
            document.apply(cleanup)
            print(f"{_lower_first(cleanup.title)}: done")
        for fill in found.make_fill_edits() if self.fill_holes else ():
            try:
                prepare_useful(document, fill)
                document.apply(fill)
            except EditError as error:
                print(f"{_lower_first(fill.title)} ({fill.name}): not done, {error}")
            else:
                print(f"{_lower_first(fill.title)} ({fill.name}): done")


def _lower_first(text: str) -> str:
    return text[0].lower() + text[1:]


def find_gone(document: Document) -> set[int]:
    """Find the instances of which every splat is deleted."""
    return {each.id for each in document.scene.table if document.summarize_instance(each.id).is_deleted}


def _describe_deletion(found: DeletionReport, document: Document) -> list[str]:
    lines = [f"deleted {found.name}: {found.summary}"]
    for number, count in sorted(found.carriers.items(), key=lambda pair: -pair[1]):
        carrier = f"instance {number} ({document.scene.table[number].name})" if number else "no instance"
        lines.append(f"  residue that belongs to {carrier}: {count:,}")
    return lines
