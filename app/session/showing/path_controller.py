"""The camera's path: keys at seconds of a film, a playhead, and playing it as a preview."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from instdrive_app.session.context import SessionContext
from instdrive_app.session.navigation import Navigation
from instdrive_app.session.showing.path_steps import Keys, PathStep, PathSteps
from instdrive_app.state import Intrinsics, Viewpoint
from instdrive_core.filming.camera_path import CLOSEST, CameraKey, CameraPath
from instdrive_core.filming.path_file import MOST_KEYS, read_camera_keys, store_camera_keys
from instdrive_core.scene.transforms import Similarity
from instdrive_core.wording import phrase

GAP = 2.0
"""Seconds from the last key to one that is added after it."""
FILM = (1600, 900)
"""Size of the preview's film."""


class PathController:
    """Keys are kept in the state, where exports find them; they are no edits of the scene, but undone like those."""

    def __init__(self, context: SessionContext, navigation: Navigation) -> None:
        self._context, self._navigation = context, navigation
        self._steps = PathSteps()
        self._chosen: int | None = None
        self._played: Viewpoint | None = None
        """Where the preview looks from; the user has taken over where the view shows anything else."""
        self.playhead = 0.0
        """Seconds into the film."""
        self.playing = False
        self.version = 0
        """Rises with every change that a project has to hold."""

    @property
    def keys(self) -> Keys:
        """The keys, in the film's order."""
        return self._context.state.path_keys

    @property
    def end(self) -> float:
        """Seconds of the last key; 0 without keys."""
        return self.keys[-1].at if self.keys else 0.0

    @property
    def chosen(self) -> int | None:
        """Index of the key that was added, moved or gone to last; None where that is gone."""
        return self._chosen if self._chosen is not None and self._chosen < len(self.keys) else None

    def forget(self) -> None:
        """Forget the path, since another document is open."""
        self._context.state.path_keys = ()
        self._steps.clear()
        self.playhead, self._chosen, self.playing, self.version = 0.0, None, False, 0

    def add(self) -> None:
        """Add the present view as a key: at the playhead, or some time after the last key if it is at a key."""
        if len(self.keys) >= MOST_KEYS:
            self._context.messages.error(phrase("The path has {most} keys already; delete some", most=MOST_KEYS))
            return
        is_free = all(abs(key.at - self.playhead) >= CLOSEST for key in self.keys)
        at = self.playhead if is_free else self.end + GAP
        self._set("add a key to the camera path", (*self.keys, self._capture(at)), at)

    def replace(self) -> None:
        """Give the chosen key the present view."""
        if self.chosen is not None:
            keys, at = list(self.keys), self.keys[self.chosen].at
            keys[self.chosen] = self._capture(at)
            self._set("change a key of the camera path", tuple(keys), at)

    def delete(self) -> None:
        """Delete the chosen key; the one after it is chosen then."""
        index = self.chosen
        if index is not None:
            self._set("delete a key of the camera path", self.keys[:index] + self.keys[index + 1 :], self.playhead)
            self._chosen = min(index, len(self.keys) - 1) if self.keys else None

    def move(self, index: int, at: float, gesture: str | None = None) -> int:
        """Move a key to other seconds of the film, past others as well; returns its index then.

        Where another key is too close, it comes as near as it can. Moves of one `gesture` are undone together.
        """
        if not 0 <= index < len(self.keys):
            return index
        others = self.keys[:index] + self.keys[index + 1 :]
        at = _find_free(at, others)
        if at != self.keys[index].at:
            moved = (*others, replace(self.keys[index], at=at))
            self._set("move a key of the camera path", moved, at, gesture)
        self._choose_at(at)
        self.playhead = at
        return index if self._chosen is None else self._chosen

    def go_to_key(self, index: int) -> None:
        """Choose a key and look from it; does nothing where there is none of this index."""
        if 0 <= index < len(self.keys):
            self._chosen = index
            self.seek(self.keys[index].at)

    def seek(self, at: float) -> None:
        """Move the playhead, and look from there."""
        self.playhead = max(at, 0.0)
        if not self.keys:
            return
        path = CameraPath(self.keys)
        camera, distance = path.find_camera(at, *FILM), self._context.state.viewpoint.pivot_distance
        self._played = Viewpoint(camera.world_from_camera, Intrinsics.from_camera(camera), distance)
        self._navigation.look_from_kept(self._played, path.find_drive_time(at))

    def toggle_playing(self) -> None:
        """Play the path, from its start where the playhead is at the end; or stop."""
        self.playing = not self.playing and len(self.keys) > 1
        if self.playing:
            self._navigation.playing = False
            start = next(key.at for key in self.keys)
            self.seek(self.playhead if start <= self.playhead < self.end else start)

    def tick(self, seconds: float) -> None:
        """Advance the playing path by `seconds`; called once a frame. Stops where the user looks elsewhere."""
        if not self.playing:
            return
        is_left = self._context.state.viewpoint is not self._played
        if len(self.keys) < 2 or self._navigation.playing or is_left:
            self.playing = False
            return
        at = min(self.playhead + seconds, self.end)
        self.seek(at)
        self.playing = at < self.end

    def can_undo(self) -> bool:
        """Whether undo is about the path now, and not about an edit of the scene."""
        document = self._context.document
        return document is not None and self._steps.find_undo(document.history) is not None

    def can_redo(self) -> bool:
        """Whether redo is about the path now, and not about an edit of the scene."""
        document = self._context.document
        return document is not None and self._steps.find_redo(document.history) is not None

    def undo(self) -> bool:
        """Undo the last change of the keys where undo is about that; returns whether it was."""
        document = self._context.document
        step = self._steps.find_undo(document.history) if document is not None else None
        if document is None or step is None:
            return False
        self._steps.note_undo(document.history)
        self._show_step("Undid", step, step.before)
        return True

    def redo(self) -> bool:
        """Do the change of the keys again that was undone last where redo is about that; returns whether it was."""
        document = self._context.document
        step = self._steps.find_redo(document.history) if document is not None else None
        if step is None:
            return False
        self._steps.note_redo()
        self._show_step("Redid", step, step.after)
        return True

    def follow_scene(self, matrix: Similarity) -> None:
        """Keep filming the same things after the whole scene was transformed by [s R | t]."""
        if self.keys:
            self._context.state.path_keys = CameraPath(self.keys).transform(matrix)

    def store(self) -> list[dict[str, object]]:
        """Convert the keys into JSON values."""
        return store_camera_keys(self.keys)

    def restore(self, stored: object) -> None:
        """Take over what `store` gave; nothing where it makes no sense."""
        self.forget()
        try:
            self._context.state.path_keys = read_camera_keys(stored)
        except ValueError:
            return

    def _capture(self, at: float) -> CameraKey:
        state = self._context.state
        return CameraKey(at, state.time, state.viewpoint.make_film_camera())

    def _set(self, title: str, keys: Keys, at: float, gesture: str | None = None) -> None:
        """Change the keys by one step, and choose the one at these seconds."""
        document, before = self._context.document, self.keys
        after = tuple(sorted(keys, key=lambda key: key.at))
        self._context.state.path_keys = after
        self.version += 1
        self.playhead = at
        self._choose_at(at)
        if document is not None:
            self._steps.push(document.history, PathStep(title, before, after, gesture, None))

    def _show_step(self, verb: str, step: PathStep, keys: Keys) -> None:
        self._context.state.path_keys = keys
        self.version += 1
        self.playing = False
        self._choose_at(self.playhead)
        self._context.messages.info(f"{verb}: {step.title}")

    def _choose_at(self, at: float) -> None:
        self._chosen = next((index for index, key in enumerate(self.keys) if key.at == at), None)


def _find_free(at: float, others: Keys) -> float:
    """Find the seconds nearest to `at`, from 0 on, that keep the least distance to the other keys."""
    taken = np.array([key.at for key in others])
    wanted = np.concatenate([[max(at, 0.0)], taken - CLOSEST, taken + CLOSEST])
    gaps = np.abs(wanted[:, None] - taken).min(axis=1, initial=np.inf)
    free = wanted[(wanted >= 0) & (gaps >= CLOSEST - 1e-9)]
    return float(free[np.abs(free - at).argmin()])
