"""What a driver knows of its clips, kept in ``fleet.json`` so that the next driver knows it, too."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from instdrive_core.errors import DataError
from instdrive_core.fleet.place import FleetPlace
from instdrive_core.fleet.plan import FleetClip

FILE, VERSION = "fleet.json", 1
ClipStatus = Literal["waiting", "running", "done", "failed", "stopped"]


@dataclass(frozen=True)
class FleetAttempt:
    """A try that did not end with a finished clip."""

    at: float
    """When it ended, seconds since 1970."""
    problem: str
    """Why it ended."""


@dataclass(frozen=True)
class ClipRecord:
    """A clip and how far it is."""

    clip: FleetClip
    status: ClipStatus = "waiting"
    attempts: tuple[FleetAttempt, ...] = ()
    """Tries that failed, oldest first, those of earlier drivers included."""

    @property
    def problem(self) -> str:
        """Why the clip failed; empty where it did not."""
        return self.attempts[-1].problem if self.status == "failed" and self.attempts else ""

    def add_attempt(self, problem: str, moment: float) -> ClipRecord:
        """Note a failed try."""
        return replace(self, attempts=(*self.attempts, FleetAttempt(moment, problem)))


def read_records(place: FleetPlace, clips: Sequence[FleetClip]) -> tuple[ClipRecord, ...]:
    """Read what earlier drivers knew of these clips; every one waits.

    Clips that they knew besides follow, with the status that they had; what was still to be done there is stopped.

    Raises DataError where the file is damaged, or where a run of the same name is another clip's.
    """
    file = Path(place.root) / FILE
    content = place.read(FILE)
    if content is None:
        return tuple(ClipRecord(clip) for clip in clips)
    try:
        known = {entry["name"]: entry for entry in json.loads(content)["clips"]}
        records = []
        for clip in clips:
            entry = known.get(clip.name, {"source": clip.source, "attempts": []})
            if entry["source"] != clip.source:
                problem = f"the run {clip.name!r} is of the clip {entry['source']}, not of {clip.source}"
                raise DataError(file, problem, "Choose another --out")
            records.append(ClipRecord(clip, "waiting", _parse_attempts(entry)))
        for name in sorted(known.keys() - {clip.name for clip in clips}):
            status = known[name]["status"] if known[name]["status"] in ("done", "failed") else "stopped"
            other = FleetClip(str(name), str(known[name]["source"]))
            records.append(ClipRecord(other, status, _parse_attempts(known[name])))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        problem = f"is damaged ({type(error).__name__}: {error})"
        raise DataError(file, problem, "Delete it: finished runs are found again by themselves") from error
    return tuple(records)


def _parse_attempts(entry: Mapping[str, Any]) -> tuple[FleetAttempt, ...]:
    return tuple(FleetAttempt(float(each["at"]), str(each["problem"])) for each in entry["attempts"])


def write_records(
    place: FleetPlace, status: str, records: Sequence[ClipRecord], figures: Sequence[Mapping[str, Any]]
) -> None:
    """Write the clips with their figures, and whether the driver works, is done or was stopped."""
    entries = [
        {
            "name": record.clip.name,
            "source": record.clip.source,
            "status": record.status,
            "problem": record.problem,
            "attempts": [asdict(attempt) for attempt in record.attempts],
            **values,
        }
        for record, values in zip(records, figures, strict=True)
    ]
    content = {"version": VERSION, "status": status, "clips": entries}
    place.write(FILE, (json.dumps(content, indent=1) + "\n").encode())
