"""Recolouring instances and adjusting their colours."""

from __future__ import annotations

from instdrive_app.session.context import SessionContext
from instdrive_core.edits.bases.adjustments import AdjustKind
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.color import RecolorInstances, RecolorMode, ResetColors

Ids = tuple[int, ...]


class ColorController:
    """Holds the colour of the inspector's picker, and gives colours to instances."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self.mode: RecolorMode = "tint"
        self.color: tuple[float, float, float] = (0.82, 0.13, 0.13)
        """RGB in [0, 1]."""

    def recolor(
        self, ids: Ids, mode: RecolorMode, color: tuple[float, float, float], gesture: str | None = None
    ) -> None:
        """Give instances a colour (RGB in [0, 1]); calls of one `gesture` become one step."""
        if ids:
            self._context.apply(lambda: RecolorInstances(ids, mode, color), gesture)

    def recolor_as_picked(self, ids: Ids) -> None:
        """Give instances the colour of the inspector's picker."""
        self.recolor(ids, self.mode, self.color)

    def adjust(self, ids: Ids, what: AdjustKind, amount: float, gesture: str | None = None) -> None:
        """Set one adjustment of instances' colours; calls of one `gesture` become one step."""
        if ids:
            self._context.apply(lambda: SetAdjustment(ids, what, amount), gesture)

    def reset(self, ids: Ids) -> None:
        """Give instances their trained colours and opacities back."""
        if ids:
            self._context.apply(lambda: ResetColors(ids))
