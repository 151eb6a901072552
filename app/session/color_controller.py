"""Recolouring instances and adjusting their colours."""

from __future__ import annotations

from typing import Literal

import numpy as np

from instdrive_app.session.context import SessionContext
from instdrive_core.edits.bases.adjustments import AdjustKind
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.color import RecolorInstances, RecolorMode, ResetColors
from instdrive_core.edits.kinds.paint import TOLERANCE, PaintInstances
from instdrive_core.edits.queries.body_color import RGB
from instdrive_core.instances.vehicles import is_vehicle
from instdrive_core.maths.spherical_harmonics import color_from_dc

Ids = tuple[int, ...]
_FRAMES_TO_SHOW = 4
"""Frames until the inspector is in front: what brings it there closes popups."""
ColorMode = RecolorMode | Literal["paint"]


class ColorController:
    """Holds the colour of the inspector's picker, and gives colours to instances."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self.mode: ColorMode | None = None
        """What recolouring means; None until the user chooses: paint for vehicles, tint for the rest."""
        self.color: RGB = (0.82, 0.13, 0.13)
        """RGB in [0, 1]."""
        self.tolerance = TOLERANCE
        """How far from the reference colour `paint` reaches, 0 to 1."""
        self.reference: RGB | None = None
        """The colour that `paint` replaces, RGB in [0, 1]; None: each instance's body colour."""
        self.picks_reference = False
        """Whether the next click into the picture says what the reference colour is."""
        self._frames_to_picker = -1

    def find_mode(self, ids: Ids) -> ColorMode:
        """Find what recolouring means for these instances."""
        document = self._context.document
        if self.mode is not None or document is None or not ids:
            return self.mode or "tint"
        return "paint" if all(is_vehicle(document.scene.table[number]) for number in ids) else "tint"

    def ask_color(self) -> None:
        """Open the inspector's colour picker; nothing changes yet."""
        self._frames_to_picker = _FRAMES_TO_SHOW

    def take_question(self) -> bool:
        """Whether the colour picker is to be opened now; says so once. Call it in each frame the inspector is drawn."""
        self._frames_to_picker = max(self._frames_to_picker - 1, -1)
        return self._frames_to_picker == 0

    def recolor(self, ids: Ids, mode: ColorMode, color: RGB, gesture: str | None = None) -> None:
        """Give instances a colour (RGB in [0, 1]); calls of one `gesture` become one step."""
        if not ids:
            return
        if mode == "paint":
            self._context.apply(lambda: PaintInstances(ids, color, self.tolerance, self.reference), gesture)
        else:
            self._context.apply(lambda: RecolorInstances(ids, mode, color), gesture)

    def set_tolerance(self, ids: Ids, tolerance: float, gesture: str | None = None) -> None:
        """Paint more or less of the instances, if they are painted."""
        self.tolerance = tolerance
        self._paint_again(ids, gesture)

    def set_reference(self, ids: Ids, reference: RGB | None) -> None:
        """Choose which colour is replaced, None for each instance's body colour, and paint again where painted."""
        self.reference, self.picks_reference = reference, False
        self._paint_again(ids)

    def take_reference_from(self, row: int) -> None:
        """Choose the trained colour of a splat as the one that is replaced in the selected instances."""
        document = self._context.document
        if document is not None:
            red, green, blue = np.clip(color_from_dc(document.scene.gaussians.sh_dc[row]), 0, 1).tolist()
            self.set_reference(document.find_selected_instances(), (red, green, blue))

    def _paint_again(self, ids: Ids, gesture: str | None = None) -> None:
        """Paint with the present settings where the last step of the history painted these instances."""
        document = self._context.document
        last = document.history.done[-1] if document is not None and document.history.done else None
        if isinstance(last, PaintInstances) and last.ids == ids:
            self.recolor(ids, "paint", last.color, gesture)

    def adjust(self, ids: Ids, what: AdjustKind, amount: float, gesture: str | None = None) -> None:
        """Set one adjustment of instances' colours; calls of one `gesture` become one step."""
        if ids:
            self._context.apply(lambda: SetAdjustment(ids, what, amount), gesture)

    def reset(self, ids: Ids) -> None:
        """Give instances their trained colours and opacities back."""
        if ids:
            self._context.apply(lambda: ResetColors(ids))
