"""Edits the way of the selected thing by its keys: on the ground, in time, and by its speed."""

from __future__ import annotations

import math
from pathlib import Path
from weakref import ref

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.session.context import SessionContext
from instdrive_app.session.mapping.map_things import place_footprint
from instdrive_core.edits.bases.relabel import create_instances
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.driving.known_keys import find_way_keys
from instdrive_core.edits.kinds.driving.ways import drive_instance
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.formats.objects.scenario_ways import is_scenario, read_scenario_way
from instdrive_core.scene.vehicle_path import sample_path
from instdrive_core.scene.ways.way_file import read_way
from instdrive_core.scene.ways.way_keys import Keys, delete_key, extend_way, insert_key

SAMPLES = 12
"""Points between two keys by which the line of a way is drawn."""


class PathEditor:
    """Holds which key is chosen, and the keys as they are while one of them is dragged; an edit is made at the end."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._state = context, context.state
        self._known: tuple[object, Keys] | None = None
        self._preview: tuple[object, Keys] | None = None
        self._chosen: tuple[int, int] | None = None

    @property
    def is_active(self) -> bool:
        """Whether keys are shown and can be dragged: the path tool is in the hand, and a thing is selected."""
        return self._state.tool == "path" and self.subject != 0

    @property
    def subject(self) -> int:
        """The instance whose way is edited: the selected one, if it drives or is a single thing; 0 = none."""
        document = self._context.document
        if document is None:
            return 0
        entries = [document.scene.table[number] for number in document.find_selected_instances()]
        nodes = {entry.node for entry in entries}
        if len(nodes) != 1 or (not entries[0].node and (len(entries) > 1 or not is_compact(entries[0]))):
            return 0
        return entries[0].id

    @property
    def drives(self) -> bool:
        """Whether the thing has a track, and so keys that can be changed; what stands gets its first by a click."""
        document, subject = self._context.document, self.subject
        return bool(document is not None and subject and document.scene.table[subject].node)

    @property
    def keys(self) -> Keys:
        """The keys of the way, as they are now; none without a thing."""
        document, subject = self._context.document, self.subject
        if document is None or not subject:
            return ()
        key = self._build_key(document, subject)
        if self._preview is not None and self._preview[0] == key:
            return self._preview[1]
        if self._known is None or self._known[0] != key:
            self._known = (key, find_way_keys(document, subject, self._state.time))
        return self._known[1]

    @property
    def chosen(self) -> int | None:
        """Index of the chosen key; None where none is."""
        if self._chosen is None or self._chosen[0] != self.subject or self._chosen[1] >= len(self.keys):
            return None
        return self._chosen[1]

    @property
    def is_dragging(self) -> bool:
        """Whether keys are shown that are not yet those of the thing."""
        document = self._context.document
        return (
            self._preview is not None
            and document is not None
            and self._preview[0] == self._build_key(document, self.subject)
        )

    def choose(self, index: int | None) -> None:
        """Choose a key."""
        self._chosen = None if index is None else (self.subject, index)

    def preview(self, keys: Keys) -> None:
        """Show other keys until `finish` or `cancel`."""
        document = self._context.document
        if document is not None:
            self._preview = (self._build_key(document, self.subject), keys)

    def finish(self) -> None:
        """Let the thing drive the keys that are shown, as one step."""
        keys, is_dragging = self.keys, self.is_dragging
        self._preview = None
        if is_dragging:
            self.set_keys(keys)

    def cancel(self) -> None:
        """Show the thing's own keys again."""
        self._preview = None

    def set_keys(self, keys: Keys) -> None:
        """Let the thing drive these keys; what stood still starts driving, as another instance, which is selected."""
        document, subject = self._context.document, self.subject
        if document is None or not subject or keys == self.keys:
            return
        entry = document.scene.table[subject]

        def make() -> Edit:
            edit = drive_instance(entry, keys)
            if entry.node:
                return edit
            (added,) = create_instances(document, [None])
            return CompoundEdit((edit, SelectInstances((added.id,), "replace")), edit.title)

        chosen = self.chosen
        if self._context.apply(make):
            self.choose(chosen)

    def read_file(self, path: Path) -> None:
        """Let the thing drive the way of a file: keys as JSON, or its own in an OpenSCENARIO file, by name or ID.

        Raises DataError where the file holds no way, OptionError where it is not clear whose is meant.
        """
        document, subject = self._context.document, self.subject
        if document is None or not subject:
            return
        if is_scenario(str(path)):
            name = document.scene.table[subject].name
            wanted = (name, str(subject), f"instance {subject}")
            self.set_keys(read_scenario_way(str(path), document.scene.origin, wanted))
        else:
            self.set_keys(read_way(path))

    def add(self, time: float) -> None:
        """Add a key where the thing is at a time (seconds), and choose it."""
        if self.drives and self.keys:
            keys, index = insert_key(self.keys, time)
            self.set_keys(keys)
            self.choose(index)

    def extend(self, x: float, y: float) -> None:
        """Let the thing drive on to a place of the ground (metres) after its last key; what stands starts now."""
        if self.keys:
            keys = extend_way(self.keys, x, y, self._state.time)
            self.set_keys(keys)
            self.choose(len(keys) - 1)

    def delete_chosen(self) -> None:
        """Take the chosen key away; the one before is chosen then."""
        index = self.chosen
        if index is not None and self.drives and len(self.keys) > 1:
            self.set_keys(delete_key(self.keys, index))
            self.choose(max(index - 1, 0))

    def find_ground(self, time: float | None = None) -> float:
        """Find the height (metres) of the ground on which the thing stands at a time (seconds), or at the shown one."""
        document, subject = self._context.document, self.subject
        assert document is not None
        entry = document.scene.table[subject]
        if entry.node:
            track = document.scene.actors[entry.node - 1]
            middle = track.interpolate_position(self._state.time if time is None else time)
            return float(middle[2] - track.dimensions[2] / 2)
        return float(entry.bounds[0][2])

    def find_places(self) -> Float64[ndarray, "k 3"]:
        """Find where the keys that are shown lie on the ground, metres."""
        keys = self.keys
        return np.array([(key.x, key.y, self.find_ground(key.time)) for key in keys]).reshape(-1, 3)

    def find_line(self) -> Float64[ndarray, "n 3"]:
        """Find the line (metres) of the way on the ground through the keys that are shown."""
        keys = self.keys
        if len(keys) < 2:
            return self.find_places()
        at = np.array([key.time for key in keys])
        times = np.unique(np.r_[np.linspace(at[0], at[-1], SAMPLES * (len(keys) - 1) + 1), at])
        return np.c_[sample_path(keys, times).places, np.interp(times, at, self.find_places()[:, 2])]

    def find_ghost(self) -> Float64[ndarray, "4 2"] | None:
        """Find the footprint (metres) where the thing would be at the shown time by the keys that are dragged now."""
        document, subject = self._context.document, self.subject
        if document is None or not self.is_dragging:
            return None
        entry = document.scene.table[subject]
        if not entry.node:
            return None
        track = document.scene.actors[entry.node - 1]
        own = track.interpolate_pose(self._state.time)
        found = sample_path(self.keys, np.array([self._state.time]), math.atan2(own[1, 1], own[0, 1]))
        heading, pose = float(found.headings[0]), np.eye(4)
        pose[:2, 0], pose[:2, 1] = (math.sin(heading), -math.cos(heading)), (math.cos(heading), math.sin(heading))
        pose[:2, 3] = found.places[0]
        return place_footprint(pose, track.dimensions)

    def _build_key(self, document: Document, subject: int) -> tuple[object, ...]:
        versions = document.versions
        time = 0.0 if subject and document.scene.table[subject].node else self._state.time
        return ref(document), subject, versions.tracks, versions.transforms, versions.table, time
