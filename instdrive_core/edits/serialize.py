"""Edits as JSON and back, so that a project file or a script can replay them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.registry import EDIT_KINDS
from instdrive_core.errors import EditError
from instdrive_core.files.json_value import parse_json

_MAX_DEPTH = 8


def edit_from_json(entry: object, depth: int = 0) -> Edit:
    """The edit that `Edit.to_json` described. Raises EditError where the entry is none."""
    name = entry.get("kind") if isinstance(entry, dict) else entry
    if not isinstance(entry, dict) or not isinstance(name, str) or name not in EDIT_KINDS:
        raise EditError(f"edit kind {name!r} is not known; known are {', '.join(EDIT_KINDS)}")
    kind = EDIT_KINDS[name]
    parameters: dict[str, Any] = {key: value for key, value in entry.items() if key != "kind"}
    if unknown := set(parameters) - set(kind.parameters):
        raise EditError(f"edit {name!r} has no parameter {min(unknown)!r}; it has {sorted(kind.parameters)}")
    try:
        if kind.nested:
            if depth == _MAX_DEPTH:
                raise EditError(f"edits are nested more than {_MAX_DEPTH} deep")
            parameters[kind.nested] = tuple(edit_from_json(part, depth + 1) for part in parameters[kind.nested])
        values: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in parameters.items()}
        return kind.edit(**values)
    except (TypeError, ValueError, KeyError) as error:
        raise EditError(f"edit {name!r} cannot be made from {parameters}: {error}") from error


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
