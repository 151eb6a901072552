"""What ``instdrive apply`` tells of deletions, and does about what they leave."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from instdrive_core.edits.deletion_report import DeletionReport, report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.errors import OptionError


@dataclass(frozen=True)
class DeletionOptions:
    """Done after all other edits, for all instances that were deleted together."""

    report: bool = False
    """Print what deletions leave: residue (strays of what was deleted) and holes (ground that no photo showed)."""
    absorb_residue: bool = False
    """Delete the residue of deletions, too."""
    fill_holes: bool = False
    """Clone ground from around into the holes that deletions leave; the copies are marked as synthetic."""

    def follow(self, document: Document, edits: Iterable[Edit], time: float) -> None:
        """Report on the deletions among `edits` and clean up after them; `time` in seconds."""
        if not (self.report or self.absorb_residue or self.fill_holes):
            return
        table = document.scene.table
        ids = {number for edit in edits if isinstance(edit, DeleteInstances) for number in edit.ids if number in table}
        if not ids:
            raise OptionError("nothing was deleted, so nothing can be left of it; name instances with --delete")
        found = report_deletion(document, ids, time)
        if self.report:
            print("\n".join(_describe_deletion(found, document)))
        cleanup = found.make_absorb_edit() if self.absorb_residue else None
        fill = found.make_fill_edit() if self.fill_holes else None
        for edit in (cleanup, fill):
            if edit is not None:
                document.apply(edit)
                print(f"{edit.title[0].lower()}{edit.title[1:]}: done")


def _describe_deletion(found: DeletionReport, document: Document) -> list[str]:
    lines = [f"deleted {found.name}: {found.summary}"]
    for number, count in sorted(found.carriers.items(), key=lambda pair: -pair[1]):
        carrier = f"instance {number} ({document.scene.table[number].name})" if number else "no instance"
        lines.append(f"  residue that belongs to {carrier}: {count:,}")
    return lines
