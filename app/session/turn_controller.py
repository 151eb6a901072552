"""Turning the whole scene upright: guessing which way is up, turning, and taking the view along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.session.context import SessionContext
from instdrive_app.session.navigation import Navigation
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.scene_up import estimate_document_up
from instdrive_core.errors import EditError
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.maths.vectors import Vector
from instdrive_core.project.sources import has_cameras_beside
from instdrive_core.scene.transforms import Similarity, compose_transforms, invert_transform
from instdrive_core.scene.up_estimate import UpEstimate
from instdrive_core.scene.upright import (
    UP,
    Axis,
    compute_axis_direction,
    compute_upright_rotation,
    find_nearest_axis,
)
from instdrive_core.wording import phrase

VIEW_SNAP = 10.0
"""Degrees from an axis within which the view's up means the axis: nobody can tilt the view more exactly."""


@dataclass(frozen=True)
class TurnOffer:
    """What the bar over the view offers."""

    estimate: UpEstimate
    is_answered: bool = False
    """Whether the scene was turned since."""
    ids: tuple[int, ...] = ()
    """The inserted instances that it is about; empty for the whole scene."""


class TurnController:
    """Turns the open scene as a whole."""

    def __init__(self, context: SessionContext, navigation: Navigation, turned: Callable[[Similarity], None]) -> None:
        """`turned` gets the change [s R | t] whenever the scene was turned, by undo as well."""
        self._context, self._state = context, context.state
        self._jobs, self._messages = context.jobs, context.messages
        self._navigation, self._turned = navigation, turned
        self._seen: tuple[Document | None, Float64[ndarray, "3 4"]] = (None, np.eye(3, 4))
        self._stated: Axis | None = None
        self.estimate: UpEstimate | None = None
        """Which way is up in the open scene as it lies now; None while that is being estimated."""
        self.offer: TurnOffer | None = None
        """The question that waits for the user; None where there is none."""
        self._next_offers: list[TurnOffer] = []

    def enter(self, document: Document, stated: Axis | None) -> None:
        """Follow another document, whose file format states that this axis is up.

        Where it comes from another program and seems to lie on its side, the user is told how to turn it upright.
        """
        self._seen, self._stated, self.offer = (document, document.orientation), stated, None
        self._next_offers.clear()
        if (
            not len(document.scene.table)
            and (not document.scene.views or has_cameras_beside(document))
            and not document.history.edits
            and document.scene.start is None
        ):
            self.guess_up(self._tell)

    def guess_up(self, then: Callable[[UpEstimate], None] = lambda _: None) -> None:
        """Estimate which way is up now, in the background; `then` gets the estimate."""
        document, stated = self._context.document, self._stated
        self.estimate = None
        if document is None:
            return
        frozen, orientation = freeze_document(document), document.orientation

        def finish(found: UpEstimate) -> None:
            if self._context.document is document and document.orientation is orientation:
                self.estimate = found
                then(found)

        self._jobs.submit_in_background(
            "Estimating which way is up", lambda: estimate_document_up(frozen, stated), finish
        )

    def find_view_up(self) -> tuple[Float64[ndarray, "3"], float]:
        """Find the unit vector that is up in the view, snapped to a near axis, and how many degrees it was off."""
        up = -self._state.viewpoint.world_from_camera[:3, 1]
        axis, angle = find_nearest_axis(up)
        return (compute_axis_direction(axis), angle) if angle <= VIEW_SNAP else (up, 0.0)

    def turn(self, up: Float64[ndarray, "3"], scale: float = 1.0) -> None:
        """Turn the scene so that `up` points up, and scale it; in the background where it takes longer than a frame."""
        document = self._context.document
        if document is None:
            return
        x, y, z = up.tolist()
        direction: Vector = (x, y, z)
        edit = TurnScene.make_upright(direction, scale)
        if edit.is_quick:
            self._context.apply(edit)
            return
        frozen = freeze_document(document)

        def finish(_: None) -> None:
            if self._context.document is document:
                self._context.apply(edit)

        self._jobs.submit("Turning the scene", lambda: edit.prepare(frozen), finish)

    def ask_about_inserted(self, estimate: UpEstimate, ids: tuple[int, ...]) -> None:
        """Ask which way is up in an inserted scene, which became these instances, unless it stands upright."""
        if _is_doubtful(estimate):
            offer = TurnOffer(estimate, ids=ids)
            if self.offer is not None and self.offer.ids and not self.offer.is_answered:
                self._next_offers.append(offer)
            else:
                self.offer = offer

    def accept_offer(self) -> None:
        """Turn what is asked about so that what the estimate says is up points up."""
        if self.offer is not None:
            self._turn_offered(self.offer.estimate.direction)

    def flip(self) -> None:
        """Turn what is asked about upside down."""
        self._turn_offered(-compute_axis_direction(UP))

    def _turn_offered(self, up: Float64[ndarray, "3"]) -> None:
        document, offer = self._context.document, self.offer
        if document is not None and offer is not None and offer.ids:
            w, x, y, z = quaternion_from_matrix(compute_upright_rotation(up)).tolist()
            edit = MoveInstances(offer.ids, rotation=(w, x, y, z), time=self._state.time, on_ground=True)
            try:
                edit.compute_matrix(document)
            except EditError:  # no ground is known there
                edit.on_ground = False
            if not self._context.apply(edit):
                return
        else:
            self.turn(up)
        if offer is not None:
            self.offer = replace(offer, is_answered=True)

    def dismiss_offer(self) -> None:
        """Ask no longer; of the next inserted scene where several were inserted."""
        self.offer = self._next_offers.pop(0) if self._next_offers else None

    def tick(self) -> None:
        """Take the view along where an edit, undo or redo has turned the scene; called once a frame."""
        document, (seen, before) = self._context.document, self._seen
        if (
            document is not None
            and self.offer is not None
            and any(i not in document.scene.table for i in self.offer.ids)
        ):
            self.dismiss_offer()  # the insertion was undone
        if document is None or document is not seen or document.orientation is before:
            return
        self._seen = (document, document.orientation)
        change = compose_transforms(document.orientation, invert_transform(before))
        self._navigation.follow_scene(change)
        self._turned(change)

    def _tell(self, found: UpEstimate) -> None:
        if not _is_doubtful(found):
            return
        self.offer = TurnOffer(found)
        if found.confident:
            self._messages.info(
                phrase(
                    "This scene seems to lie on its side: {words} is up, judging by {reason}. Move › Turn "
                    "upright… turns it",
                    words=found.words,
                    reason=found.reason,
                )
            )


def _is_doubtful(estimate: UpEstimate) -> bool:
    """Whether the user should be asked: nothing says what is up, or something else than z is."""
    return not estimate.confident or estimate.axis != UP or estimate.tilt > 0
