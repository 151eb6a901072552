"""The camera's path: keys at seconds of a film, a playhead, and playing it as a preview."""

from __future__ import annotations

from dataclasses import replace

from instdrive_app.session.context import SessionContext
from instdrive_app.session.navigation import Navigation
from instdrive_app.state import Intrinsics, Viewpoint
from instdrive_core.filming.camera_path import CLOSEST, CameraKey, CameraPath
from instdrive_core.filming.path_file import MOST_KEYS, read_camera_keys, store_camera_keys
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.transforms import Similarity

GAP = 2.0
"""Seconds from the last key to one that is added after it."""
FILM = (1600, 900)
"""Size of the preview's film."""


class PathController:
    """Keys are kept in the state, where exports find them; they are no edits of the scene."""

    def __init__(self, context: SessionContext, navigation: Navigation) -> None:
        self._context, self._navigation = context, navigation
        self.playhead = 0.0
        """Seconds into the film."""
        self.chosen: int | None = None
        """Index of the key that was added, moved or gone to last."""
        self.playing = False
        self.version = 0
        """Rises with every change that a project has to hold."""

    @property
    def keys(self) -> tuple[CameraKey, ...]:
        """The keys, in the film's order."""
        return self._context.state.path_keys

    @property
    def end(self) -> float:
        """Seconds of the last key; 0 without keys."""
        return self.keys[-1].at if self.keys else 0.0

    def forget(self) -> None:
        """Forget the path, since another document is open."""
        self._context.state.path_keys = ()
        self.playhead, self.chosen, self.playing, self.version = 0.0, None, False, 0

    def add(self) -> None:
        """Add the present view as a key: at the playhead, or some time after the last key if it is at a key."""
        if len(self.keys) >= MOST_KEYS:
            self._context.messages.error(f"The path has {MOST_KEYS} keys already; delete some")
            return
        is_free = all(abs(key.at - self.playhead) >= CLOSEST for key in self.keys)
        at = self.playhead if is_free else self.end + GAP
        key = self._capture(at)
        self._set(tuple(sorted((*self.keys, key), key=lambda one: one.at)))
        self.chosen, self.playhead = self.keys.index(key), at

    def replace(self) -> None:
        """Give the chosen key the present view."""
        if self.chosen is not None:
            keys = list(self.keys)
            keys[self.chosen] = self._capture(keys[self.chosen].at)
            self._set(tuple(keys))

    def delete(self) -> None:
        """Delete the chosen key; the one after it is chosen then."""
        if self.chosen is not None:
            self._set(self.keys[: self.chosen] + self.keys[self.chosen + 1 :])
            self.chosen = min(self.chosen, len(self.keys) - 1) if self.keys else None

    def move(self, index: int, at: float) -> None:
        """Move a key to other seconds of the film, between its neighbours."""
        low = self.keys[index - 1].at + CLOSEST if index else 0.0
        high = self.keys[index + 1].at - CLOSEST if index + 1 < len(self.keys) else max(at, low)
        at = min(max(at, low), high)
        if at != self.keys[index].at:
            keys = list(self.keys)
            keys[index] = replace(keys[index], at=at)
            self._set(tuple(keys))
        self.chosen, self.playhead = index, at

    def go_to_key(self, index: int) -> None:
        """Choose a key and look from it."""
        self.chosen = index
        self.seek(self.keys[index].at)

    def seek(self, at: float) -> None:
        """Move the playhead, and look from there."""
        self.playhead = max(at, 0.0)
        if not self.keys:
            return
        path = CameraPath(self.keys)
        camera, distance = path.find_camera(at, *FILM), self._context.state.viewpoint.pivot_distance
        viewpoint = Viewpoint(camera.world_from_camera, Intrinsics.from_camera(camera), distance)
        self._navigation.look_from_kept(viewpoint, path.find_drive_time(at))

    def toggle_playing(self) -> None:
        """Play the path, from its start where the playhead is at the end; or stop."""
        self.playing = not self.playing and len(self.keys) > 1
        if self.playing:
            self._navigation.playing = False
            start = min(key.at for key in self.keys)
            if not start <= self.playhead < self.end:
                self.playhead = start

    def tick(self, seconds: float) -> None:
        """Advance the playing path by `seconds`; called once a frame."""
        if not self.playing:
            return
        if len(self.keys) < 2 or self._navigation.playing:
            self.playing = False
            return
        at = min(self.playhead + seconds, self.end)
        self.seek(at)
        self.playing = at < self.end

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
        lens, pose = state.viewpoint.lens, state.viewpoint.world_from_camera
        return CameraKey(at, state.time, Camera(lens.fx, lens.fy, lens.cx, lens.cy, lens.width, lens.height, pose))

    def _set(self, keys: tuple[CameraKey, ...]) -> None:
        self._context.state.path_keys = keys
        self.version += 1
