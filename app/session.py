"""The editor without a window: document, view state, messages, jobs, and what each action does to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from instdrive_app import camera
from instdrive_app.commands import Commands
from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_app.state import EditorState, Viewpoint
from instdrive_app.timeline import Timeline
from instdrive_core.edits.bake import baked
from instdrive_core.edits.base import Edit
from instdrive_core.edits.color import RecolorInstances, RecolorMode
from instdrive_core.edits.delete import DeleteInstances
from instdrive_core.edits.document import Document
from instdrive_core.edits.instances import RenameInstance
from instdrive_core.edits.select import SelectCodeword, SelectInstances, SelectMode, SelectNone
from instdrive_core.edits.visibility import HideInstances, ShowAll
from instdrive_core.errors import EditError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag


class EditorSession:
    """One open document and the user's view of it. All methods run on the UI's thread."""

    def __init__(self, wake: Callable[[], None] = lambda: None) -> None:
        self.state = EditorState()
        self.messages = Messages()
        self.jobs = Jobs(self.messages.error, wake)
        self.commands = Commands()
        self.document: Document | None = None
        self.path: Path | None = None
        self.timeline = Timeline(())
        self.dialog: str | None = None
        """The dialog to open in the next frame: ``open``, ``export``, ``rename`` or ``shortcuts``."""
        self.renamed: int = 0
        """The instance that the rename dialog is about."""
        self.recolor_mode: RecolorMode = "tint"
        self.recolor_color: tuple[float, float, float] = (0.82, 0.13, 0.13)
        """What the inspector's colour picker holds."""
        self.playing = False
        self.quitting = False
        self.last_export: Path | None = None
        self._play_clock = 0.0

    # ------------------------------------------------------------------ files

    def open(self, path: Path) -> None:
        """Open a scene in the background."""
        self.jobs.submit(f"Opening {path.name}", lambda: _opened(path), lambda document: self.show(document, path))

    def show(self, document: Document, path: Path | None = None) -> None:
        """Make a document the one that is edited."""
        scene = document.scene
        self.document, self.path = document, path
        self.timeline = Timeline(scene.views, scene.actors)
        self.state = replace(self.state, hovered=0, time=self.timeline.start, dataset_view=None)
        if scene.views:
            self.look_through(0)
        else:
            self.look_from(camera.overview(scene.gaussians.means))
        name = path.name if path else "the scene"
        self.messages.info(f"Opened {name}: {len(scene):,} splats, {len(scene.table):,} instances")

    def export(self, path: Path) -> None:
        """Write the edited scene in the background: a file holds the shown moment, a folder keeps the tracks."""
        document = self.document
        if document is None:
            return
        moment = self.state.time if path.suffix else None

        def work() -> tuple[Path, int]:
            scene = baked(document, moment)
            save_scene(path, scene)
            return path, len(scene)

        self.jobs.submit(f"Exporting {path.name}", work, self._exported)

    def _exported(self, result: tuple[Path, int]) -> None:
        self.last_export, count = result
        self.messages.info(f"Exported {count:,} splats to {self.last_export}")

    # ------------------------------------------------------------------ edits

    def apply(self, make: Callable[..., Edit], *parameters: object, gesture: str | None = None) -> bool:
        """Make an edit and do it; returns whether it was done. What hinders it is told to the user."""
        if self.document is None:
            return False
        if self.jobs.blocking:
            self.messages.error("Please wait until the work under way is done")
            return False
        try:
            self.document.apply(make(*parameters), gesture)
        except EditError as error:
            self.messages.error(str(error))
            return False
        return True

    def undo(self) -> None:
        """Undo one step."""
        if self.document is not None and not self.jobs.blocking:
            self.document.undo()

    def redo(self) -> None:
        """Redo one step."""
        if self.document is not None and not self.jobs.blocking:
            self.document.redo()

    def jump(self, cursor: int) -> None:
        """Undo or redo until `cursor` edits are done."""
        document = self.document
        if document is None or self.jobs.blocking:
            return
        while document.history.cursor > cursor and document.undo():
            pass
        while document.history.cursor < cursor and document.redo():
            pass

    @property
    def selected(self) -> tuple[int, ...]:
        """IDs of the selected instances."""
        return self.document.selected_instances() if self.document else ()

    @property
    def has_codewords(self) -> bool:
        """Whether the open scene knows codewords."""
        return self.document is not None and self.document.scene.code_bits > 0

    def select(self, ids: tuple[int, ...], mode: SelectMode = "replace") -> None:
        """Select instances, add them or take them away; selecting nothing clears."""
        if ids:
            self.apply(SelectInstances, ids, mode)
        elif mode == "replace":
            self.clear_selection()

    def select_codeword_of(self, instance: int) -> None:
        """Select all splats that share an instance's codeword."""
        if self.document is not None:
            self.apply(SelectCodeword, self.document.scene.table[instance].codeword)

    def clear_selection(self) -> None:
        """Select nothing."""
        if self.document is not None and len(self.document.state.rows_with(Flag.SELECTED)):
            self.apply(SelectNone)

    def delete(self, ids: tuple[int, ...]) -> None:
        """Delete instances."""
        if ids and self.apply(DeleteInstances, ids) and self.state.hovered in ids:
            self.state.hovered = 0

    def hide(self, ids: tuple[int, ...], hidden: bool = True) -> None:
        """Hide instances or show them again."""
        if ids:
            self.apply(HideInstances, ids, hidden)

    def show_all(self) -> None:
        """Show everything that is hidden."""
        self.apply(ShowAll)

    def solo(self, ids: tuple[int, ...]) -> None:
        """Hide every other instance; where that is so already, show all."""
        if self.document is None or not ids:
            return
        others = tuple(i for i in self.document.visible_instances() if i not in ids)
        if others:
            self.apply(HideInstances, others)
        else:
            self.apply(ShowAll)

    def recolor(
        self, ids: tuple[int, ...], mode: RecolorMode, color: tuple[float, float, float], gesture: str | None = None
    ) -> None:
        """Give instances a colour; calls of one `gesture` become one step."""
        if ids:
            self.apply(RecolorInstances, ids, mode, color, gesture=gesture)

    def ask_name(self, instance: int) -> None:
        """Open the rename dialog."""
        self.renamed, self.dialog = instance, "rename"

    def rename(self, instance: int, name: str) -> None:
        """Give an instance another name."""
        self.apply(RenameInstance, instance, name)

    # ------------------------------------------------------------------ view

    def look_from(self, viewpoint: Viewpoint) -> None:
        """Leave the dataset camera and look from elsewhere."""
        self.state.viewpoint, self.state.dataset_view = viewpoint, None

    def look_through(self, index: int) -> None:
        """Look through a dataset camera, at its moment."""
        assert self.document is not None
        view = self.document.scene.views[index]
        self.state.viewpoint = camera.through(view, self.state.viewpoint.pivot_distance)
        self.state.dataset_view, self.state.time = index, view.time

    def set_time(self, time: float) -> None:
        """Show another moment; a dataset camera moves along to its nearest photo, the moment is then the photo's."""
        self.state.time = time
        current = self.state.dataset_view
        if current is not None and self.document is not None:
            name = self.document.scene.views[current].name
            self.look_through(self.timeline.nearest_view(name, time))

    def step(self, count: int) -> None:
        """Go `count` time steps onwards, around the ends."""
        if self.timeline.steps:
            self.set_time(self.timeline.stepped(self.state.time, count))

    def choose_camera(self, name: str) -> None:
        """Look through the dataset camera of this name at the present moment."""
        self.look_through(self.timeline.nearest_view(name, self.state.time))

    def frame(self, ids: tuple[int, ...]) -> None:
        """Bring instances, or everything, into view."""
        if self.document is None:
            return
        means = self.world_means(ids)
        if len(means):
            self.look_from(camera.framed_points(self.state.viewpoint, means))

    def world_means(self, ids: tuple[int, ...]) -> np.ndarray:
        """World positions (n, 3) of instances at the shown moment, deleted splats left out; of all for no IDs."""
        assert self.document is not None
        scene, state = self.document.scene, self.document.state
        rows = self.document.rows_of(ids) if ids else np.arange(len(scene))
        rows = rows[(state.flags[rows] & Flag.DELETED) == 0]
        poses, _ = scene.at(self.state.time)
        matrices = poses[scene.nodes[rows]]
        return np.einsum("nij,nj->ni", matrices[:, :3, :3], scene.gaussians.means[rows]) + matrices[:, :3, 3]

    def tick(self, seconds: float) -> None:
        """Once a frame: deliver finished jobs; where the drive plays, go on by `seconds`."""
        self.jobs.poll()
        if self.playing and len(self.timeline.steps) > 1:
            self._play_clock += seconds
            pace = (self.timeline.end - self.timeline.start) / (len(self.timeline.steps) - 1)
            if self._play_clock >= pace:
                self._play_clock = min(self._play_clock - pace, pace)
                self.step(1)

    def close(self) -> None:
        """Wait for running work."""
        self.jobs.close()


def _opened(path: Path) -> Document:
    scene: Scene = open_scene(path)
    document = Document(scene)
    document.counts()  # builds the index of instances here, so that the first click finds it built
    return document
