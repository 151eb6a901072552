"""What a user may choose about a synthetic clip."""

from __future__ import annotations

from dataclasses import dataclass

from instdrive_core.errors import OptionError

MAX_STEPS = 100
"""Files are named by two digits, and the street is long enough for ten seconds."""


@dataclass(frozen=True)
class StreetConfig:
    """A procedural street and how it is recorded. The same config gives the same files, byte for byte."""

    seed: int = 0
    """Chooses layout, models, colours, traffic and sun."""
    steps: int = 20
    """Time steps at 10 Hz (1–100)."""
    width: int = 480
    """Width of the photos in pixels; PandaSet's are 1920×1080."""
    height: int = 270
    """Height of the photos in pixels."""
    lidar_azimuths: int = 1000
    """LiDAR columns per turn; 64 beams each."""

    def __post_init__(self) -> None:
        limits = {
            "seed": (0, 2**32 - 1),
            "steps": (1, MAX_STEPS),
            "width": (16, 3840),
            "height": (9, 2160),
            "lidar_azimuths": (16, 4000),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise OptionError(f"{name} is {value}; choose {low} to {high}")
