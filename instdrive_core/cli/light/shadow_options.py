"""The options of ``instdrive apply`` that lay shadows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from instdrive_core.cli.arguments import check_known_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.scene_light import estimate_light
from instdrive_core.edits.holes.shade import SceneLight
from instdrive_core.edits.kinds.light.cast_shadows import list_put, plan_shadows
from instdrive_core.edits.kinds.light.lay_shadow import LayShadow, make_lay_shadow
from instdrive_core.errors import EditError
from instdrive_core.wording import format_count


@dataclass(frozen=True)
class ShadowOptions:
    """Shadows below things that were put somewhere."""

    shadows: bool = True
    """Lay a shadow below everything that is moved, copied, inserted or sent another way here."""
    shadow: tuple[int, ...] = ()
    """IDs of other instances below which a shadow is laid, wherever they stand."""

    def follow(self, document: Document, steps: Iterable[Edit], time: float) -> None:
        """Do what the options ask for, once `steps` are done, and say how light falls.

        Raises OptionError for an unknown ID, EditError where one that was asked for cannot be laid.
        """
        asked = check_known_ids(self.shadow, document.scene.table) if self.shadow else ()
        put = list_put(steps)
        if not asked and not (self.shadows and put.ids):
            return
        light = estimate_light(document, time)
        planned = plan_shadows(freeze_document(document), put, light, time) if self.shadows else ()
        laid = {edit.id for edit in planned if isinstance(edit, LayShadow)}
        for edit in (*planned, *(make_lay_shadow(number, light, time) for number in asked if number not in laid)):
            try:
                document.apply(edit)
            except EditError as error:
                raise EditError(f"--shadow: {error}") from error
        laid |= {*asked}
        if laid:
            print(f"{format_count(len(laid), 'shadow')} laid: {_describe(light)}")


def _describe(light: SceneLight) -> str:
    below = f"{light.contact:.0%} darker below"
    return f"{below}, the sun takes {light.sun_share:.0%}" if any(light.sun) else f"{below}, no sun was found"
