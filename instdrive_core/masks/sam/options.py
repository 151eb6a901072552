"""Options of Segment Anything, apart from what needs its packages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from instdrive_core.errors import OptionError

SUGGESTED = "facebook/sam2.1-hiera-small"
"""Weights on the Hugging Face hub that are used by default."""


@dataclass(frozen=True)
class SamOptions:
    """Options of masks by Segment Anything."""

    model: str = SUGGESTED
    """Weights: a name on the Hugging Face hub, or a local folder with config.json and *.safetensors."""
    batch: int = 64
    """Points asked at a time; less needs less memory."""
    points_per_side: int = 32
    """The model is asked at a grid of this many points to each side."""
    predicted_iou: float = 0.8
    """Masks that the model itself believes to be worse than this are dropped."""
    stability: float = 0.92
    """Masks with a border less sharp than this are dropped (1 = sharpest)."""
    overlap: float = 0.7
    """One of several masks is kept where their boxes have a larger IoU than this."""
    min_area: float = 0.0002
    """Share of the photo below which masks, their holes and their islands are dropped."""
    whole_objects: bool = True
    """Let parts join the object that contains them: cars instead of wheels and doors."""
    containment: float = 0.85
    """Share of a mask that must lie within a larger one to be a part of it."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the model runs; `auto`: on an NVIDIA GPU if torch sees one."""
    offline: bool = False
    """Never download: use what is on this machine."""

    def __post_init__(self) -> None:
        for name, low in (("batch", 1), ("points_per_side", 1)):
            if getattr(self, name) < low:
                raise OptionError(f"{name} is {getattr(self, name)}; it must be {low} or more")
        for name in ("predicted_iou", "stability", "overlap", "min_area"):
            if not 0 <= getattr(self, name) <= 1:
                raise OptionError(f"{name} is {getattr(self, name)}; it must lie between 0 and 1")
        if not 0.5 < self.containment <= 1:
            raise OptionError(f"containment is {self.containment}; it must be more than 0.5 and at most 1")
