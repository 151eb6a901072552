"""Every kind of edit, one record each. A new edit is its file in `kinds`, its line here and its test."""

from __future__ import annotations

from dataclasses import dataclass, fields

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.classes import SetClass, SetInstanceClass
from instdrive_core.edits.kinds.color import RecolorInstances, ResetColors
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteRows, DeleteSelected
from instdrive_core.edits.kinds.driving.set_path import SetPath
from instdrive_core.edits.kinds.driving.start_driving import StartDriving
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.edits.kinds.grow import GrowSelection, ShrinkSelection
from instdrive_core.edits.kinds.hide_rows import HideRows
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.labels.relabel_rows import RelabelRows
from instdrive_core.edits.kinds.light.lay_shadow import LayShadow
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.paint import PaintInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.select import (
    InvertSelection,
    SelectAll,
    SelectClass,
    SelectCodeword,
    SelectInstances,
    SelectNone,
)
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.shape.complete import CompleteInstance
from instdrive_core.edits.kinds.solo import SoloInstances
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances, ShowAll


@dataclass(frozen=True)
class EditKind:
    """One kind of edit, for programs that list, draw or read edits; its class knows the rest."""

    edit: type[Edit]
    icon: str
    """Constant of Font Awesome 6 for the history, as ``imgui_bundle.icons_fontawesome_6`` names it."""
    nested: str = ""
    """The parameter that holds edits; empty where there is none."""
    is_old: bool = False
    """Only read from files that were saved before: nothing makes such edits any more."""

    @property
    def name(self) -> str:
        """The kind as files name it."""
        return self.edit.kind

    @property
    def selects_only(self) -> bool:
        """Whether nothing but the selection changes: then there is nothing to save."""
        return self.edit.selects_only

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the constructor's parameters, which are also those of the edit's JSON."""
        return tuple(entry.name for entry in fields(self.edit) if entry.init)  # type: ignore[arg-type]


EDIT_KINDS: dict[str, EditKind] = {
    kind.name: kind
    for kind in (
        EditKind(AbsorbFloaters, "ICON_FA_BROOM"),
        EditKind(AdjustInstances, "ICON_FA_SLIDERS", is_old=True),
        EditKind(CompleteInstance, "ICON_FA_CLONE"),
        EditKind(CompoundEdit, "ICON_FA_LAYER_GROUP", nested="edits"),
        EditKind(DeleteInstances, "ICON_FA_TRASH"),
        EditKind(DeleteRows, "ICON_FA_TRASH"),
        EditKind(DeleteSelected, "ICON_FA_TRASH"),
        EditKind(DuplicateInstances, "ICON_FA_CLONE"),
        EditKind(FillHole, "ICON_FA_FILL_DRIP"),
        EditKind(FindObjects, "ICON_FA_CUBES"),
        EditKind(GrowSelection, "ICON_FA_UP_RIGHT_AND_DOWN_LEFT_FROM_CENTER"),
        EditKind(HideInstances, "ICON_FA_EYE_SLASH"),
        EditKind(HideRows, "ICON_FA_CROP_SIMPLE"),
        EditKind(InsertScene, "ICON_FA_FILE_IMPORT"),
        EditKind(InvertSelection, "ICON_FA_CIRCLE_HALF_STROKE"),
        EditKind(LayShadow, "ICON_FA_CLOUD_SUN"),
        EditKind(LockInstances, "ICON_FA_LOCK"),
        EditKind(MergeInstances, "ICON_FA_OBJECT_GROUP"),
        EditKind(MoveInstances, "ICON_FA_ARROWS_UP_DOWN_LEFT_RIGHT"),
        EditKind(PaintInstances, "ICON_FA_SPRAY_CAN"),
        EditKind(ReassignSelected, "ICON_FA_RIGHT_LEFT"),
        EditKind(RecolorInstances, "ICON_FA_PAINTBRUSH"),
        EditKind(RelabelRows, "ICON_FA_RIGHT_LEFT"),
        EditKind(RenameInstance, "ICON_FA_PEN"),
        EditKind(ResetColors, "ICON_FA_ARROW_ROTATE_LEFT"),
        EditKind(ResetMoves, "ICON_FA_ARROW_ROTATE_LEFT"),
        EditKind(SelectAll, "ICON_FA_ARROW_POINTER"),
        EditKind(SelectClass, "ICON_FA_ARROW_POINTER"),
        EditKind(SelectCodeword, "ICON_FA_ARROW_POINTER"),
        EditKind(SelectInstances, "ICON_FA_ARROW_POINTER"),
        EditKind(SelectNone, "ICON_FA_ARROW_POINTER"),
        EditKind(SelectRows, "ICON_FA_ARROW_POINTER"),
        EditKind(SetAdjustment, "ICON_FA_SLIDERS"),
        EditKind(SetClass, "ICON_FA_TAG"),
        EditKind(SetInstanceClass, "ICON_FA_TAG", is_old=True),
        EditKind(SetPath, "ICON_FA_ROUTE"),
        EditKind(ShowAll, "ICON_FA_EYE"),
        EditKind(ShrinkSelection, "ICON_FA_DOWN_LEFT_AND_UP_RIGHT_TO_CENTER"),
        EditKind(SoloInstances, "ICON_FA_BULLSEYE"),
        EditKind(SplitInstance, "ICON_FA_OBJECT_UNGROUP"),
        EditKind(StartDriving, "ICON_FA_CAR_SIDE"),
        EditKind(TurnScene, "ICON_FA_ARROWS_SPIN"),
    )
}
"""Every kind of edit by its name in files."""
