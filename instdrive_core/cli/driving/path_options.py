"""The options of ``instdrive apply`` that let things drive other ways."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.cli.arguments import check_known_ids, parse_assignment
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.driving.ways import Template, change_way, drive_instance, park_at
from instdrive_core.errors import OptionError
from instdrive_core.formats.objects.scenario_ways import is_scenario, read_scenario_way
from instdrive_core.instances.table import Instance
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey
from instdrive_core.scene.ways.way_file import read_way

_EXAMPLE = "--path 17=way.json, 17=lane:3.5@2, 17=stop@3, 17=speed:0.5@0, 17=turn:90@2, 17=wait:2@3 or 17=start@1"
_TEMPLATES: dict[str, Template] = {
    "lane": "lane",
    "stop": "stop",
    "speed": "speed",
    "turn": "turn",
    "wait": "wait",
    "start": "start",
}
_TEMPLATE = re.compile(r"(lane|stop|speed|turn|wait|start)(?::([+-]?\d+(?:\.\d+)?))?@(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class PathOptions:
    """Other ways for vehicles."""

    path: tuple[str, ...] = ()
    """Ways as ID=FILE with keys as JSON, as ID=FILE.xosc or ID=FILE.xosc#ENTITY of OpenSCENARIO, or as a change of a
    mover's own way: ID=lane:METRES@SECOND (left above 0), ID=stop@SECOND, ID=speed:FACTOR@SECOND,
    ID=turn:DEGREES@SECOND, ID=wait:SECONDS@SECOND, ID=start@SECOND. What stands still starts driving with a file."""
    park: tuple[str, ...] = ()
    """Movers that are parked where they are at a time, as ID@SECOND."""

    def edits(self, document: Document) -> list[Edit]:
        """Build the edits. Raises OptionError where an option cannot be read, DataError for a file that is wrong."""
        return [*(_build_path(text, document) for text in self.path), *(_park(text, document) for text in self.park)]


def _build_path(text: str, document: Document) -> Edit:
    number, value = parse_assignment(text, _EXAMPLE)
    entry = document.scene.table[check_known_ids([number], document.scene.table)[0]]
    found = _TEMPLATE.fullmatch(value.strip())
    if found is None:
        return drive_instance(entry, _read_keys(value.strip(), entry, document))
    kind, amount, start = _TEMPLATES[found[1]], found[2], float(found[3])
    if (amount is None) != (kind in ("stop", "start")) or (kind in ("speed", "wait") and not _is_fit(kind, amount)):
        raise OptionError(f"{value!r} in {text!r} is no change of a way; write e.g. {_EXAMPLE}")
    return drive_instance(entry, change_way(_require_track(entry, document), kind, float(amount or 0), start))


def _read_keys(value: str, entry: Instance, document: Document) -> tuple[PathKey, ...]:
    if not is_scenario(value):
        return read_way(Path(value))
    return read_scenario_way(value, document.scene.origin, (entry.name, str(entry.id), f"instance {entry.id}"))


def _is_fit(kind: Template, amount: str | None) -> bool:
    """Whether a factor of the speed, or seconds of standing, are possible."""
    return 0 <= float(amount or 0) <= (10 if kind == "speed" else 600)


def _park(text: str, document: Document) -> Edit:
    found = re.fullmatch(r"(\d+)@(\d+(?:\.\d+)?)", text.strip())
    if found is None:
        raise OptionError(f"{text!r} is not an ID and a time; write e.g. --park 17@2.5")
    entry = document.scene.table[check_known_ids([int(found[1])], document.scene.table)[0]]
    return drive_instance(entry, park_at(_require_track(entry, document), float(found[2])))


def _require_track(entry: Instance, document: Document) -> Track:
    if not entry.node:
        raise OptionError(f"instance {entry.id} stands still: it has no way to change. Give it a file of keys")
    return document.scene.actors[entry.node - 1]
