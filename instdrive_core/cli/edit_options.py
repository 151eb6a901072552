"""The edits of ``instdrive apply`` that move, copy, adjust and relabel instances, as options of the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.cli.arguments import check_known_ids, parse_assignment
from instdrive_core.cli.insertions import build_insertions
from instdrive_core.edits.bases.adjustments import RANGES
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit, describe_ids
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.classes import SetClass
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteSelected
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import InvertSelection, SelectClass, SelectInstances
from instdrive_core.edits.kinds.shape.complete import make_completion
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.errors import OptionError
from instdrive_core.instances.table import InstanceTable


@dataclass(frozen=True)
class EditOptions:
    """Done in the order listed here."""

    insert: tuple[Path, ...] = ()
    """Scene files whose splats are added: where their coordinates have them if both scenes say where in the world
    their origins are, else at their own numbers."""
    absorb: tuple[int, ...] = ()
    """IDs of compact instances that take in the floaters in and around them."""
    merge: tuple[str, ...] = ()
    """Instances that become part of another, as INTO=ID,ID,…"""
    split: tuple[int, ...] = ()
    """IDs of instances to be split into the parts that do not hang together."""
    complete: tuple[int, ...] = ()
    """IDs of things, such as parked cars, whose unseen side becomes the mirror image of the side that was seen."""
    set_class: tuple[str, ...] = ()
    """New classes as ID=CLASS."""
    adjust: tuple[str, ...] = ()
    """Adjustments of colour as ID=WHAT:AMOUNT, e.g. 4=hue:30. The amount is absolute, where the editor's slider would
    stand: it replaces an earlier one of the same kind and counts from the trained colour or the last recolour. Hue:
    degrees from -180 to 180, 0 changes nothing. Temperature: -1 (cool) to 1 (warm), 0 changes nothing. Brightness,
    contrast and saturation: factors from 0 to 4, 1 changes nothing. Opacity: a factor from 0 to 1. A recolour
    in the same command comes later and replaces all but the opacity."""
    move: tuple[str, ...] = ()
    """Moves as ID=X,Y,Z in metres, or ID=X,Y,Z,YAW,SCALE with degrees about the vertical axis and a factor; moving
    objects are turned where they are at --time."""
    ground_snap: bool = False
    """Set what is moved down on the ground."""
    along_lane: bool = False
    """Move along the lane only."""
    duplicate: tuple[str, ...] = ()
    """Copies as ID=X,Y,Z in metres from the original."""
    delete_class: tuple[str, ...] = ()
    """Classes whose instances are deleted, e.g. Car."""
    keep: tuple[int, ...] = ()
    """IDs of the instances that are kept: everything else is deleted."""

    def edits(self, document: Document, time: float, is_turned: bool) -> list[Edit]:
        """The edits in order.

        Args:
            document: as it was opened.
            time: seconds into the drive.
            is_turned: whether edits before these turn or scale it.

        Raises OptionError where an option cannot be read, DataError where a scene cannot be opened.
        """
        table = document.scene.table
        steps: list[Edit] = [*build_insertions(document, self.insert, is_turned)]
        steps += [AbsorbFloaters(number) for number in check_known_ids(self.absorb, table)] if self.absorb else []
        steps += [_parse_merge(text, table) for text in self.merge]
        steps += [SplitInstance(number) for number in check_known_ids(self.split, table)] if self.split else []
        steps += [make_completion(document, number) for number in self._find_incomplete(table)]
        for text in self.set_class:
            number, name = parse_assignment(text, "--set-class 4=Car")
            steps.append(SetClass(check_known_ids([number], table), name))
        steps += [_parse_adjustment(text, table) for text in self.adjust]
        steps += [self._move(text, table, time) for text in self.move]
        for text in self.duplicate:
            ids, (x, y, z) = _parse_numbers(text, "--duplicate 4=0,6,0", table, 3, 3)
            steps.append(DuplicateInstances(ids, (x, y, z)))
        steps += [_build_deletion(SelectClass(name), name=f"Delete class {name}") for name in self.delete_class]
        if self.keep:
            kept = SelectInstances(check_known_ids(self.keep, table))
            steps.append(_build_deletion(kept, InvertSelection(), name=f"Keep {describe_ids(kept.ids)} only"))
        return steps

    def _find_incomplete(self, table: InstanceTable) -> tuple[int, ...]:
        return check_known_ids(self.complete, table) if self.complete else ()

    def _move(self, text: str, table: InstanceTable, time: float) -> MoveInstances:
        ids, values = _parse_numbers(text, "--move 4=1.5,0,0 or --move 4=0,0,0,90", table, 3, 5)
        x, y, z, yaw, scale = [*values, *(0.0, 0.0, 0.0, 0.0, 1.0)[len(values) :]]
        half = math.radians(yaw) / 2
        return MoveInstances(
            ids,
            (x, y, z),
            (math.cos(half), 0.0, 0.0, math.sin(half)),
            scale,
            time=time,
            along_lane=self.along_lane,
            on_ground=self.ground_snap,
        )


def _parse_numbers(
    text: str, example: str, table: InstanceTable, least: int, most: int
) -> tuple[tuple[int, ...], list[float]]:
    number, values = parse_assignment(text, example)
    try:
        found = [float(value) for value in values.split(",")]
    except ValueError:
        found = []
    if not least <= len(found) <= most or not all(math.isfinite(value) for value in found):
        raise OptionError(f"{values!r} in {text!r} is not a list of {least} numbers; write e.g. {example}")
    return check_known_ids([number], table), found


def _build_deletion(*selection: Edit, name: str) -> CompoundEdit:
    return CompoundEdit((*selection, DeleteSelected()), name)


def _parse_merge(text: str, table: InstanceTable) -> MergeInstances:
    example = "--merge 4=7,9"
    into, names = parse_assignment(text, example)
    parts = names.split(",")
    if not all(part.strip().isdecimal() for part in parts):
        raise OptionError(f"{names!r} in {text!r} is not a list of IDs; write e.g. {example}")
    return MergeInstances(check_known_ids([int(part) for part in parts], table), check_known_ids([into], table)[0])


def _parse_adjustment(text: str, table: InstanceTable) -> SetAdjustment:
    example = "--adjust 4=hue:30"
    number, setting = parse_assignment(text, example)
    what, _, amount = setting.partition(":")
    for kind in RANGES:
        if kind == what:
            try:
                return SetAdjustment(check_known_ids([number], table), kind, float(amount))
            except ValueError as error:
                raise OptionError(f"{amount!r} in {text!r} is not a number; write e.g. {example}") from error
    raise OptionError(f"{what!r} in {text!r} is not one of {', '.join(RANGES)}; write e.g. {example}")
