"""The manifest of a project: which scenes it edits, how far its edits are done, and what it must hold."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.formats.scene_files import FileIdentity
from instdrive_core.project.document_check import DocumentCheck
from instdrive_core.project.sources import RecordedSource

FORMAT_NAME, FORMAT_VERSION = "instdrive project", 1
MAX_NAME = 4096
"""Characters of a path."""


class OtherVersionError(ValueError):
    """The project is of a version that this program does not read."""


@dataclass(frozen=True)
class Manifest:
    """The manifest of a project."""

    program: str
    """Version of the program that saved it."""
    saved: str
    """When, ISO 8601 with the time zone."""
    base: RecordedSource
    inserted: dict[str, RecordedSource]
    """Files that edits insert, by the names that edits give them."""
    edits: int
    """How many there are, those undone included."""
    cursor: int
    """How many of them are done."""
    check: DocumentCheck
    """Checksums of the document when it was saved."""
    members: tuple[str, ...]
    """All other members of the archive."""


def find_program_version() -> str:
    """The version of this program, for files that it writes."""
    try:
        return version("instdrive")
    except PackageNotFoundError:
        return "unknown"


def manifest_to_json(manifest: Manifest) -> bytes:
    """The member's content."""
    entry = {"format": FORMAT_NAME, "version": FORMAT_VERSION, **asdict(manifest)}
    entry["base"] = source_to_json(manifest.base)
    entry["inserted"] = {name: source_to_json(source) for name, source in manifest.inserted.items()}
    return (json.dumps(entry, indent=1) + "\n").encode()


def manifest_from_json(text: bytes) -> Manifest:
    """The inverse of `manifest_to_json`. Raises ValueError where a part is missing or makes no sense."""
    entry = parse_bounded_json(text)
    if not isinstance(entry, dict) or entry.get("format") != FORMAT_NAME:
        raise ValueError(f"'format' is not {FORMAT_NAME!r}")
    if entry.get("version") != FORMAT_VERSION:
        raise OtherVersionError(f"'version' is {entry.get('version')!r}, this program reads {FORMAT_VERSION}")
    edits = _get_number(entry, "edits")
    cursor = _get_number(entry, "cursor")
    if cursor > edits:
        raise ValueError(f"'cursor' is {cursor}, beyond the {edits} edits")
    inserted, members = entry.get("inserted"), entry.get("members")
    if not isinstance(inserted, dict):
        raise ValueError("'inserted' is no object")
    if not isinstance(members, list) or not all(isinstance(name, str) for name in members):
        raise ValueError("'members' is no list of names")
    return Manifest(
        _get_text(entry, "program"),
        _get_text(entry, "saved"),
        source_from_json(entry.get("base")),
        {name: source_from_json(source) for name, source in inserted.items()},
        edits,
        cursor,
        DocumentCheck(**{name: _get_number(entry.get("check"), name) for name in DocumentCheck.__dataclass_fields__}),
        tuple(members),
    )


def source_to_json(source: RecordedSource) -> dict[str, Any]:
    """One scene of a manifest."""
    entry = {"relative": source.relative, "absolute": source.absolute, **asdict(source.identity)}
    return entry if source.keep_every == 1 else entry | {"keep_every": source.keep_every}


def source_from_json(entry: Any) -> RecordedSource:
    """The inverse of `source_to_json`. Raises ValueError."""
    digest = _get_text(entry, "sha256")
    if not re.fullmatch(r"[0-9a-f]{64}", digest):
        raise ValueError(f"'sha256' is {digest[:80]!r}, not 64 hexadecimal digits")
    absolute = _get_text(entry, "absolute")
    if not absolute:
        raise ValueError("'absolute' is empty")
    keep_every = _get_number(entry, "keep_every") if "keep_every" in entry else 1
    if not 1 <= keep_every < 1 << 31:
        raise ValueError(f"'keep_every' is {keep_every}")
    return RecordedSource(
        _get_text(entry, "relative"), absolute, FileIdentity(digest, _get_number(entry, "size")), keep_every
    )


def _get_text(entry: Any, name: str) -> str:
    value = entry.get(name) if isinstance(entry, Mapping) else None
    if not isinstance(value, str) or len(value) > MAX_NAME or "\0" in value:
        raise ValueError(f"{name!r} is missing or no text of at most {MAX_NAME} characters")
    return value


def _get_number(entry: Any, name: str) -> int:
    value = entry.get(name) if isinstance(entry, Mapping) else None
    if type(value) is not int or value < 0:
        raise ValueError(f"{name!r} is {value!r}, not a whole number from 0 on")
    return value
