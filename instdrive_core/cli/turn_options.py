"""How ``instdrive apply`` stands a scene upright and gives it its true size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.scene_up import estimate_document_up
from instdrive_core.errors import OptionError
from instdrive_core.formats.registry import find_stated_up
from instdrive_core.scene.upright import AXES, Axis, compute_axis_direction


@dataclass(frozen=True)
class TurnOptions:
    """Done to the whole scene before any edit that is given as an option.

    The axes stand in the type, as else ``--up -y`` would be read as two options.
    """

    up: Axis | Literal["auto"] | str | None = None
    """Which way is up in the file: +x, -x, +y, -y, +z, -z, a direction as X,Y,Z, or auto; it becomes +z. Most files of
    other programs need -y."""
    scale: float = 1.0
    """By how much everything is made larger: 0.01 for a scene in centimetres."""

    def edits(self, document: Document, path: Path) -> list[TurnScene]:
        """The edit, or none where none is asked for. `path` is the scene's. Raises OptionError, and EditError."""
        if self.up is None:
            return [TurnScene(scale=self.scale)] if self.scale != 1 else []
        return [TurnScene.make_upright(self._direction(self.up, document, path), self.scale)]

    @staticmethod
    def _direction(text: str, document: Document, path: Path) -> tuple[float, float, float]:
        if text == "auto":
            found = estimate_document_up(document, find_stated_up(path))
            known = f"known from {found.reason}" if found.confident else "a guess, as in most files of other programs"
            print(f"up: {found.words}, {known}")
            x, y, z = found.direction.tolist()
            return x, y, z
        for axis in AXES:
            if text.lower() in (axis, axis.removeprefix("+")):
                x, y, z = compute_axis_direction(axis).tolist()
                return x, y, z
        try:
            x, y, z = (float(part) for part in text.split(","))
        except ValueError:
            x, y, z = math.nan, math.nan, math.nan
        if not math.isfinite(x + y + z) or math.hypot(x, y, z) < 1e-6:
            raise OptionError(f"--up {text!r} is no direction; give one of {', '.join(AXES)}, auto, or e.g. 0,-1,0.2")
        return x, y, z
