"""The editor without a window: the open document, the view of it, and the controllers that change both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from instdrive_app.action import ActionRegistry
from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_app.preferences.key_presets import PRESETS, merge_keys
from instdrive_app.preferences.preferences import Preferences, PreferenceStore
from instdrive_app.session.aids.aids import Aids
from instdrive_app.session.aids.screenshots import Screenshots
from instdrive_app.session.bounds_updater import BoundsUpdater
from instdrive_app.session.color_controller import ColorController
from instdrive_app.session.context import SessionContext
from instdrive_app.session.deletion_controller import DeletionController
from instdrive_app.session.driving.ego_way import EgoWay
from instdrive_app.session.driving.path_editor import PathEditor
from instdrive_app.session.export_controller import ExportController
from instdrive_app.session.files.document_files import DocumentFiles
from instdrive_app.session.files.opening import OpenedDocument, list_defects
from instdrive_app.session.files.sketches import OpeningScene, Sketches
from instdrive_app.session.history_controller import HistoryController
from instdrive_app.session.insert_controller import InsertController
from instdrive_app.session.label_controller import LabelController
from instdrive_app.session.light.shadow_controller import ShadowController
from instdrive_app.session.making.drive_recorder import DriveRecorder
from instdrive_app.session.making.improver import Improver
from instdrive_app.session.making.job_controller import JobController
from instdrive_app.session.making.object_finder import ObjectFinder
from instdrive_app.session.making.run_comparison import RunComparison
from instdrive_app.session.mapping.map_painter import MapPainter
from instdrive_app.session.move_controller import MoveController
from instdrive_app.session.navigation import Navigation
from instdrive_app.session.placing.overlap_controller import OverlapController
from instdrive_app.session.reference_pictures import ReferencePictures
from instdrive_app.session.requests import OfferCleanup, RequestQueue, do_nothing
from instdrive_app.session.selection_controller import SelectionController
from instdrive_app.session.shape.completion_controller import CompletionController
from instdrive_app.session.showing.path_controller import PathController
from instdrive_app.session.showing.photo_difference import PhotoDifference
from instdrive_app.session.showing.shown_cameras import ShownCameras
from instdrive_app.session.turn_controller import TurnController
from instdrive_app.session.value_filter import ValueFilter
from instdrive_app.session.view_memory import restore_view
from instdrive_app.session.visibility_controller import VisibilityController
from instdrive_app.state import Comparison, EditorState
from instdrive_core.edits.document.document import Document
from instdrive_core.files.user_folders import find_state_folder
from instdrive_core.filming.path_file import FIELD
from instdrive_core.formats.registry import find_stated_up
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.lint import HARMFUL, Defect
from instdrive_core.scene.transforms import Similarity
from instdrive_core.wording import format_count, phrase


class EditorSession:
    """One open document and the user's view of it; panels and actions call its controllers.

    All methods but `wake` run on the UI's thread.
    """

    def __init__(self) -> None:
        self.wake_window: Callable[[], None] = do_nothing
        """Makes the window draw a frame; set by the window, called from any thread."""
        self.preferences = PreferenceStore(find_state_folder() / "preferences.json")
        self.state = EditorState()
        self.messages = Messages()
        self.requests = RequestQueue()
        self.actions = ActionRegistry()
        self.jobs = Jobs(self.messages.error, self.wake, self.messages.info)
        self.history = HistoryController(self.jobs, self.messages)
        context = SessionContext(self.state, self.history, self.jobs, self.messages, self.requests, self.wake)

        self.aids = Aids(context)
        self.navigation = Navigation(context)
        self.sketches = Sketches(self.navigation)
        more = self._store_more, self._get_more_version
        self.files = DocumentFiles(context, self._enter, *more, self._offer_sketch)
        self.making = JobController(context, self.files)
        self.improver = Improver(context, self.files, self.making)
        self.finder = ObjectFinder(context, self.files, self.making)
        self.comparison = RunComparison(context, self.making.known, self.files.recents)
        self.screenshots = Screenshots(context, self.files)
        self.export = ExportController(context, self.files)
        self.ego_way = EgoWay()
        self.recorder = DriveRecorder(context, self.files, self.ego_way)
        self.camera_path = PathController(context, self.navigation)
        self.cameras = ShownCameras(context, self.navigation)
        self.references = ReferencePictures(self.messages.error, self.wake)
        self.difference = PhotoDifference(context)
        self.map = MapPainter(context)

        self.selection = SelectionController(context)
        self.filter = ValueFilter(context)
        self.visibility = VisibilityController(context, self.navigation.bring_into_view)
        self.colors = ColorController(context)
        self.labels = LabelController(context)
        self.movement = MoveController(context)
        self.ways = PathEditor(context)
        self.shadows = ShadowController(context, self.movement.options)
        self._overlaps = OverlapController(context)
        self.completion = CompletionController(context)
        self.deletion = DeletionController(context)
        self.orientation = TurnController(context, self.navigation, self._follow_turn)
        self.insertion = InsertController(context, self.movement, self.orientation.ask_about_inserted)
        self._keyed_by: Preferences | None = None
        self._deferred_bounds = BoundsUpdater(context)
        self.is_quitting = False

    @property
    def document(self) -> Document | None:
        """The open document."""
        return self.history.document

    def show(self, document: Document, path: Path | None = None, saved: bool = True) -> None:
        """Make a document from `path` the open one; a recovered one is not `saved`, its file lacks something."""
        scene = document.scene
        document.can_defer_bounds = True
        self.history.enter(document)
        self.aids.forget()
        self.camera_path.forget()
        self.ego_way.forget()
        self.files.enter(document, path, saved)
        self.state.hovered, self.state.hovered_camera = 0, None
        self.references.forget()
        self.navigation.enter(document)
        name = path.name if path else phrase("the scene")
        # Where there are no instances, a region would select nothing.
        self.state.region_splats = len(scene.table) == 0
        splats, instances = format_count(len(scene), "splat"), format_count(len(scene.table), "instance")
        told = phrase("Opened {name}: {splats}", name=name, splats=splats)
        if len(scene.table):
            told = phrase("Opened {name}: {splats}, {instances}", name=name, splats=splats, instances=instances)
        self.messages.info(told)
        self.orientation.enter(document, find_stated_up(path) if path else None)

    def _enter(self, opened: OpenedDocument) -> None:
        """Show what was opened from a file, from where the user looked at it when it was saved."""
        self.show(opened.document, opened.path, saved=opened.restored is None)
        self.files.autosave.follow(opened.document, opened.path, opened.restored)
        if opened.view is not None:
            restore_view(opened.view, self.state, self.navigation, len(opened.document.scene.views))
            self.navigation.keep_start()
            self.aids.bookmarks.restore(opened.view.get("bookmarks"))
            self.camera_path.restore(opened.view.get(FIELD))
            self.ego_way.restore(opened.view.get("ego_way"))
        for note in opened.notes:
            self.messages.info(note)
        if opened.document.history.done:
            self.deletion.review.resume(opened.view.get("pending") if opened.view is not None else None)
        if opened.defects is not None:
            self._tell_defects(opened.document, opened.defects)
            return
        scene = opened.document.scene  # edits may begin meanwhile
        as_opened = replace(scene, gaussians=Gaussians(**scene.gaussians.arrays()), nodes=scene.nodes.copy())
        self.files.defects = ()
        self.jobs.submit_in_background(
            "Looking for odd splats",
            lambda: list_defects(as_opened),
            lambda defects: self._tell_defects(opened.document, defects),
        )

    def _tell_defects(self, document: Document, defects: tuple[Defect, ...]) -> None:
        """Offer to remove what is wrong with a document, unless it is being edited or was closed."""
        if document is not self.document:
            return
        self.files.defects = defects
        if any(defect.kind in HARMFUL for defect in defects) and not document.history.edits:
            self.requests.put(OfferCleanup())

    def _offer_sketch(self, opening: OpeningScene, document: Document) -> None:
        self.sketches.offer(opening, document)
        self.wake()

    def _store_more(self) -> dict[str, Any]:
        """What a project keeps beside edits and view."""
        return {
            "pending": self.deletion.review.store(),
            "bookmarks": self.aids.bookmarks.store(),
            FIELD: self.camera_path.store(),
            "ego_way": self.ego_way.store(),
        }

    def _get_more_version(self) -> int:
        """Rises with every change of that by the user."""
        return self.aids.bookmarks.version + self.camera_path.version + self.ego_way.version

    def _follow_turn(self, change: Similarity) -> None:
        """Take along what knows places, after the whole scene was transformed by [s R | t]."""
        self.deletion.review.clear_all()
        self.aids.follow_scene(change)
        self.camera_path.follow_scene(change)
        self.ego_way.follow_scene(change)

    def undo(self) -> None:
        """Undo one step: of the camera path where that was changed last, else of the scene."""
        if self.jobs.is_blocking or self.history.is_jumping or not self.camera_path.undo():
            self.history.undo()

    def redo(self) -> None:
        """Redo one step: of the camera path where that was undone last, else of the scene."""
        if self.jobs.is_blocking or self.history.is_jumping or not self.camera_path.redo():
            self.history.redo()

    def wake(self) -> None:
        """Make the window draw a frame; can be called from any thread."""
        self.wake_window()

    def tick(self, seconds: float) -> None:
        """Deliver finished jobs and continue what takes several frames; called once a frame, `seconds` after the last.

        Plays the drive, too.
        """
        self.jobs.poll()
        self.sketches.tick()
        self.history.tick()
        self.files.autosave.tick()
        self.making.tick()
        self.orientation.tick()
        self._deferred_bounds.tick()
        self.navigation.tick(seconds)
        self.camera_path.tick(seconds)
        self.difference.tick(seconds, self.state.compares and self.state.comparison is Comparison.ERROR)
        self.shadows.tick(seconds, self.movement.drag is not None)
        self.map.begin_frame()
        self._overlaps.tick(seconds, self.movement.drag is not None)
        self.deletion.review.tick(seconds, self.movement.drag is not None)
        self.state.is_solo = bool(self.visibility.solo.ids)
        self.state.safe_colors = self.preferences.current.safe_colors
        self._take_keys()

    def _take_keys(self) -> None:
        """Give actions the keys of the preferences, where those have changed."""
        chosen = self.preferences.current
        if chosen is not self._keyed_by:
            self._keyed_by = chosen
            self.actions.remap(merge_keys(self.actions.usual_keys, PRESETS[chosen.preset], chosen.keys))

    def leave(self) -> None:
        """Close the window, once the user has been asked about unsaved changes and about a running job."""
        self.files.leave(lambda: self.making.leave(self.quit))

    def quit(self) -> None:
        """Close the window after this frame."""
        self.is_quitting = True

    def close(self, by_choice: bool = True) -> None:
        """Wait for running work. Not `by_choice` (after a failure), the autosave stays for the next editor to offer."""
        self.recorder.close()
        self.jobs.close()
        self.references.close()
        self.map.close()
        if by_choice:
            self.files.autosave.end()
