"""Edits to JSON and back, so that a project file or a script can replay them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import fields
from typing import Any

from instdrive_core.edits.bases.relabel import MergeInstances, RenameInstance
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.classes import SetClass, SetInstanceClass
from instdrive_core.edits.kinds.color import RecolorInstances, ResetColors
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteRows, DeleteSelected
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.edits.kinds.grow import GrowSelection, ShrinkSelection
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
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
from instdrive_core.edits.kinds.solo import SoloInstances
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances, ShowAll
from instdrive_core.errors import EditError
from instdrive_core.files.json_value import parse_json

EDITS: dict[str, type[Edit]] = {
    edit.kind: edit
    for edit in (
        AbsorbFloaters,
        AdjustInstances,
        CompoundEdit,
        DeleteInstances,
        DeleteRows,
        DeleteSelected,
        DuplicateInstances,
        FillHole,
        GrowSelection,
        HideInstances,
        InsertScene,
        InvertSelection,
        LockInstances,
        MergeInstances,
        MoveInstances,
        ReassignSelected,
        RecolorInstances,
        RenameInstance,
        ResetColors,
        ResetMoves,
        SelectAll,
        SelectClass,
        SelectCodeword,
        SelectInstances,
        SelectNone,
        SelectRows,
        SetAdjustment,
        SetClass,
        SetInstanceClass,
        ShowAll,
        ShrinkSelection,
        SoloInstances,
        SplitInstance,
        TurnScene,
    )
}
"""Every edit by its kind."""
_MAX_DEPTH = 8


def edit_from_json(entry: Any, depth: int = 0) -> Edit:
    """The edit that `Edit.to_json` described. Raises EditError where the entry is none."""
    kind = entry.get("kind") if isinstance(entry, dict) else entry
    if not isinstance(entry, dict) or not isinstance(kind, str) or kind not in EDITS:
        raise EditError(f"edit kind {kind!r} is not known; known are {', '.join(EDITS)}")
    edit_type = EDITS[kind]
    expected = {parameter.name for parameter in fields(edit_type) if parameter.init}  # type: ignore[arg-type]
    parameters: dict[str, Any] = {name: value for name, value in entry.items() if name != "kind"}
    if unknown := set(parameters) - expected:
        raise EditError(f"edit {kind!r} has no parameter {min(unknown)!r}; it has {sorted(expected)}")
    try:
        if edit_type is CompoundEdit:
            if depth == _MAX_DEPTH:
                raise EditError(f"edits are nested more than {_MAX_DEPTH} deep")
            parameters["edits"] = tuple(edit_from_json(part, depth + 1) for part in parameters["edits"])
        values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in parameters.items()}
        return edit_type(**values)
    except (TypeError, ValueError, KeyError) as error:
        raise EditError(f"edit {kind!r} cannot be made from {parameters}: {error}") from error


def edits_to_lines(edits: Iterable[Edit]) -> str:
    """One JSON object per line."""
    return "".join(json.dumps(edit.to_json()) + "\n" for edit in edits)


def edits_from_lines(text: str) -> list[Edit]:
    """The inverse of `edits_to_lines`; empty lines are passed over. Raises EditError naming the line at fault."""
    edits = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            edits.append(edit_from_json(parse_json(line)))
        except (ValueError, RecursionError, EditError) as error:
            raise EditError(f"line {number}: {error}") from error
    return edits
