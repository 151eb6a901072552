"""Moving the selection, by drags of a gizmo and by typed numbers, and duplicating it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from weakref import ref

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_app.messages import user_message
from instdrive_app.session.context import SessionContext
from instdrive_app.session.selection_box import Box, SelectionBoxes
from instdrive_core.edits.bases.append import AppendEdit
from instdrive_core.edits.bases.relabel import create_instances
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.driving.ways import Template, change_way, drive_instance, park_at
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import SCALE_LIMITS, MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.select import SelectInstances, SelectMode
from instdrive_core.edits.queries.placement import find_lane
from instdrive_core.errors import EditError
from instdrive_core.instances.vehicles import is_vehicle
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.maths.vectors import Vector, to_vector
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import extract_scale
from instdrive_core.scene.vehicle_path import PathKey
from instdrive_core.wording import phrase

COPY_GAP = 0.5
"""Metres between an object and its copy."""
LEAST_DRIVE = 0.5
"""Metres: what goes less far stands, but for errors of its boxes."""
COPIED_AT_ONCE = 50_000
"""Splats up to which copies are made within a frame."""
Ids = tuple[int, ...]
_CHANGE_WAYS, _PARK = "Change the ways of {count} objects", "Park {count} objects"


@dataclass
class MoveOptions:
    """Constraints of moves, and what follows them."""

    on_ground: bool = False
    along_lane: bool = False
    yaw_only: bool | None = None
    """None: vehicles and actors turn about the vertical only."""
    body_only: bool = True
    """Whether what drives turns on its path; otherwise its whole drive turns."""
    lays_shadows: bool = True
    """Whether what is put somewhere gets a shadow."""


@dataclass(frozen=True)
class Placement:
    """Position of the selection, heading and size of its first instance, as numbers to type."""

    position: Vector
    """Centre of the selection in the world, metres."""
    yaw: float
    """Degrees about the vertical: an actor's heading in the world, else the turn since training; the first one's."""
    scale: float
    """Size relative to the trained one; the first one's."""


@dataclass
class Drag:
    """One drag of the gizmo; every frame moves from its start, so that no errors add up."""

    document: Document
    ids: Ids
    time: float
    gesture: str
    center: Float64[ndarray, "3"]
    """Centre of the selection at the start, metres."""
    axes: Float64[ndarray, "3 3"]
    """The gizmo's axes, as columns."""
    is_reported: bool = False
    """Whether the user was told what prevents the move."""


class MoveController:
    """Moves the selected instances at the shown time."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._state, self._messages = context, context.state, context.messages
        self.options = MoveOptions()
        self.drag: Drag | None = None
        """The drag in progress."""
        self._gestures = count()
        self._boxes = SelectionBoxes()
        self._lane: tuple[object, Float64[ndarray, "3"] | None] | None = None

    @property
    def ids(self) -> Ids:
        """IDs of the selected instances."""
        document = self._context.document
        return document.find_selected_instances() if document is not None else ()

    @property
    def yaw_only(self) -> bool:
        """Whether the selection turns about the vertical only."""
        if self.options.yaw_only is not None:
            return self.options.yaw_only
        document = self._context.document
        if document is None:
            return False
        instances = [document.scene.table[number] for number in self.ids]
        return all(instance.node or is_vehicle(instance) for instance in instances)

    def find_box(self) -> Box:
        """Find the box of the selection, which must not be empty."""
        return self._boxes.find_box(self._document, self.ids, self._state.time)

    def find_center(self) -> Float64[ndarray, "3"]:
        """Find the centre of the box; unlike that of the bounds it does not move as instances turn."""
        return self.find_box().center

    def find_lane(self) -> Float64[ndarray, "3"] | None:
        """Find the unit direction of the lane at the selection (not empty); None where there is no lane."""
        if self._lane is not None and self.drag is not None:
            return self._lane[1]
        document, ids, time, place = self._document, self.ids, self._state.time, self.find_center()
        key = (ref(document), ids, time, place.tobytes(), document.versions.tracks)
        if self._lane is None or self._lane[0] != key:
            try:
                self._lane = (key, find_lane(document, ids, place, time))
            except EditError:
                self._lane = (key, None)
        return self._lane[1]

    @property
    def has_drive(self) -> bool:
        """Whether anything that is selected drives."""
        return bool(self.find_paths())

    def find_paths(self) -> tuple[Float64[ndarray, "t 3"], ...]:
        """Find the paths along which selected things drive: the middles of the lower sides of their boxes, metres."""
        document = self._context.document
        if document is None:
            return ()
        nodes = sorted({document.scene.table[number].node for number in self.ids} - {0})
        tracks = [document.scene.actors[node - 1] for node in nodes]
        return tuple(
            track.world_from_box[:, :3, 3] - track.world_from_box[:, :3, 2] * track.dimensions[2] / 2
            for track in tracks
            if track.compute_path_length() > LEAST_DRIVE
        )

    def find_placement(self) -> Placement:
        """Find the present placement of the selection, which must not be empty."""
        document, time = self._document, self._state.time
        first = document.scene.table[self.ids[0]]
        matrix = document.transforms.get_move(int(document.transforms.indices[document.find_rows((first.id,))[0]]))
        turned = document.scene.actors[first.node - 1].interpolate_pose(time) if first.node else matrix
        yaw = math.degrees(math.atan2(turned[1, 0], turned[0, 0]))
        return Placement(to_vector(self.find_center()), yaw, extract_scale(matrix))

    def place(self, before: Placement, wanted: Placement, gesture: str | None = None) -> None:
        """Move from one placement to another; onto the ground where that is switched on and no height was typed."""
        if not self.ids:
            return
        half = math.radians(wanted.yaw - before.yaw) / 2
        self._context.apply(
            lambda: MoveInstances(
                self.ids,
                to_vector(np.subtract(wanted.position, before.position)),
                (math.cos(half), 0.0, 0.0, math.sin(half)),
                clamp_scale(wanted.scale / before.scale),
                before.position,
                self._state.time,
                on_ground=self.options.on_ground and wanted.position[2] == before.position[2],
                body_only=self.options.body_only,
            ),
            gesture,
        )

    def shift_along_lane(self, metres: float, gesture: str | None = None) -> None:
        """Move along the lane by metres since the start of the `gesture`, whose moves become one step."""
        document, ids, time, ground = self._document, self.ids, self._state.time, self.options.on_ground

        def edit() -> MoveInstances:
            shift = to_vector(find_lane(document, ids, self.find_center(), time) * metres)
            return MoveInstances(ids, shift, time=time, on_ground=ground)

        self._context.apply(edit, gesture)

    def change_ways(self, template: Template, amount: float = 0.0) -> None:
        """Let what drives of the selection drive another way from the shown time on, as `change_way` has it."""
        time = self._state.time
        self._drive(lambda track: change_way(track, template, amount, time), _CHANGE_WAYS)

    def park(self) -> None:
        """Park what drives of the selection where it is now."""
        time = self._state.time
        self._drive(lambda track: park_at(track, time), _PARK)

    def _drive(self, find_keys: Callable[[Track], Sequence[PathKey]], title: str) -> None:
        document = self._document
        entries = [document.scene.table[number] for number in self.ids]
        first = {entry.node: entry for entry in reversed(entries) if entry.node}
        steps = tuple(
            drive_instance(entry, find_keys(document.scene.actors[node - 1])) for node, entry in sorted(first.items())
        )
        if steps:
            many = phrase(title, count=len(steps))
            self._context.apply(lambda: steps[0] if len(steps) == 1 else CompoundEdit(steps, many))

    def put_on_ground(self) -> None:
        """Lift or lower what is selected onto the ground, each thing by itself: streets rise."""
        ids, time = self.ids, self._state.time

        def put() -> Edit:
            each = tuple(MoveInstances((number,), time=time, on_ground=True) for number in ids)
            return each[0] if len(each) == 1 else CompoundEdit(each, MoveInstances(ids, on_ground=True).title)

        self._context.apply(put)

    def reset(self) -> None:
        """Move the selection back to where it is in the scene's file."""
        self._context.apply(lambda: ResetMoves(self.ids))

    def duplicate(self) -> None:
        """Copy the selection beside itself, along a lane where there is one; select the copy and take the move tool.

        Many splats are copied beside the window first; edits wait for them.
        """
        document, ids = self._context.document, self.ids
        if document is None or not ids:
            return
        lane = self.find_lane()
        direction = np.array([1.0, 0.0, 0.0]) if lane is None else lane
        edit = DuplicateInstances(ids, to_vector(direction * (self.find_box().extent(direction) + COPY_GAP)))
        document.run_deferred()

        def finish(_: None = None) -> None:
            if self._context.document is document and self.apply_and_select(edit, len(ids)):
                self._state.tool = "move"

        if sum(document.scene.table[i].count for i in ids) < COPIED_AT_ONCE or self._context.jobs.is_blocking:
            finish()
        else:
            self._context.jobs.submit("Copying splats", lambda: edit.prepare(document), finish)

    def apply_and_select(self, edit: AppendEdit, instances: int, mode: SelectMode = "replace") -> bool:
        """Do an edit that adds so many instances, and select them, as one step; returns whether that was done."""
        document = self._document

        def both() -> CompoundEdit:
            added = tuple(entry.id for entry in create_instances(document, [None] * instances))
            return CompoundEdit((edit, SelectInstances(added, mode)), edit.title)

        return self._context.apply(both)

    # ------------------------------------------------------------------ drags

    def begin_drag(self, axes: Float64[ndarray, "3 3"]) -> None:
        """Begin a drag of the gizmo with these axes (columns)."""
        gesture = f"gizmo {next(self._gestures)}"
        self.drag = Drag(self._document, self.ids, self._state.time, gesture, self.find_center(), axes)

    def drag_to(self, shift: Float[ndarray, "3"], rotation: Float[ndarray, "3 3"], scale: float) -> None:
        """Move by a shift (metres), a rotation matrix and a scale factor, all since the drag began."""
        drag = self.drag
        if drag is None or drag.document is not self._context.document or drag.ids != self.ids:
            self.drag = None
            return
        lane = self.find_lane() if self.options.along_lane else None
        if lane is not None:  # found once: in a scene without cameras that takes longer than a frame
            shift = lane * (lane @ shift)
        try:
            edit = MoveInstances(
                drag.ids,
                to_vector(shift),
                tuple(quaternion_from_matrix(np.asarray(rotation, np.float64)).tolist()),
                clamp_scale(scale),
                to_vector(drag.center),
                drag.time,
                yaw_only=self.yaw_only,
                along_lane=self.options.along_lane and lane is None,  # then the edit reports that no lane is known
                on_ground=self.options.on_ground,
                body_only=self.options.body_only,
            )
            drag.document.apply(edit, drag.gesture)
        except EditError as error:
            if not drag.is_reported:  # else the same message would appear in every frame
                self._messages.error(user_message(error))
            drag.is_reported = True

    def cancel_drag(self) -> None:
        """End the drag and move everything back to where it began."""
        drag, self.drag = self.drag, None
        if drag is not None and drag.document is self._context.document and drag.ids == self.ids:
            self._context.apply(lambda: MoveInstances(drag.ids, time=drag.time), drag.gesture)

    def end_drag(self) -> None:
        """End the drag."""
        self.drag = None

    @property
    def _document(self) -> Document:
        document = self._context.document
        assert document is not None, "no document is open"
        return document


def clamp_scale(scale: float) -> float:
    """Limit a scale factor to those that a move may have."""
    return float(np.clip(scale, *SCALE_LIMITS))
