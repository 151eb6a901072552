"""Which clips a fleet trains, under which names, and what each is given."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.errors import OptionError

_UNFIT = re.compile(r"[^A-Za-z0-9._-]+")
RESERVED = ("index.html", "fleet.json", "fleet.lock")
"""Names in the folder of the runs that no clip can have."""


@dataclass(frozen=True)
class FleetClip:
    """A clip of a fleet."""

    name: str
    """Folder of its run, below that of all runs."""
    source: str
    """Absolute path, or an address such as ``s3://bucket/drives/002``."""


@dataclass(frozen=True)
class ClipWishes:
    """What is made of every clip."""

    minutes: float = 20.0
    """Minutes that a clip may take; decides how many steps are trained."""
    iterations: int | None = None
    """Training steps; None = as many as the minutes allow."""
    evaluate: bool = True
    record: bool = False
    """Record the trained drive again, as ``instdrive simulate`` does."""
    checkpoint_every: int = 100
    """Training steps that a killed worker repeats at most."""


def is_address(path: str) -> bool:
    """Whether a path names something outside this machine's file system."""
    return "://" in path and not path.startswith("file://")


def normalize_path(path: str) -> str:
    """Write a local path absolute and without ``file://``, an address without a slash at its end."""
    return path.rstrip("/") if is_address(path) else str(Path(path.removeprefix("file://")).resolve())


def plan_fleet(sources: Sequence[str]) -> tuple[FleetClip, ...]:
    """Name every clip after the end of its path; equal ends are told apart by the path's checksum.

    A clip has the same name whatever other clips are given with it, unless one of them has its name.
    Raises OptionError where no clip is given, or one twice.
    """
    paths = [normalize_path(source) for source in sources]
    if not paths:
        raise OptionError("no clips are given: name one folder, video or address after another")
    for number, path in enumerate(paths):
        if path in paths[:number]:
            raise OptionError(f"{path} is given twice. Name each clip once.")
    ends = [_UNFIT.sub("-", path.split("/")[-1].split("\\")[-1]).strip(".-") or "clip" for path in paths]

    def name(end: str, path: str) -> str:
        is_free = ends.count(end) == 1 and end not in RESERVED
        return end if is_free else f"{end}-{hashlib.sha256(path.encode()).hexdigest()[:6]}"

    return tuple(FleetClip(name(end, path), path) for end, path in zip(ends, paths, strict=True))
