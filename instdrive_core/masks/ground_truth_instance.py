"""One entry of a ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class GroundTruthInstance:
    """One object, or all of one kind of surface."""

    id: int
    name: str
    class_name: str
    kind: Literal["thing", "stuff"]
    moving: bool = False
    track_id: str | None = None
    """Track of the clip that carries it; None where there is none."""
