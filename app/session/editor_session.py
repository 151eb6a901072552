"""The editor without a window: document, view state, messages, jobs, and what each action does to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_app.action import ActionRegistry
from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages, user_message
from instdrive_app.session.autosave import Autosave
from instdrive_app.session.context import SessionContext
from instdrive_app.session.deletion_review import DeletionReview
from instdrive_app.session.document_files import DocumentFiles
from instdrive_app.session.export_controller import ExportController
from instdrive_app.session.export_kinds import ExportChoice
from instdrive_app.session.history_controller import HistoryController
from instdrive_app.session.insert_controller import InsertController
from instdrive_app.session.label_controller import LabelController
from instdrive_app.session.move_controller import MoveController
from instdrive_app.session.navigation import Navigation
from instdrive_app.session.opening import OpenedDocument
from instdrive_app.session.reference_pictures import ReferencePictures
from instdrive_app.session.selection_border import SelectionBorder
from instdrive_app.session.solo_controller import SoloController
from instdrive_app.session.turn_controller import TurnController
from instdrive_app.session.view_memory import restore_view, view_as_json
from instdrive_app.state import EditorState
from instdrive_core.edits.bases.adjustments import AdjustKind
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.color import RecolorInstances, RecolorMode, ResetColors
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.kinds.select import SelectClass, SelectCodeword, SelectInstances, SelectMode, SelectNone
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances, ShowAll
from instdrive_core.errors import EditError
from instdrive_core.formats.stated_up import stated_up
from instdrive_core.project.recoverable import RecoverableSession
from instdrive_core.scene.lint import HARMFUL, Defect
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count

CAUGHT_UP = 150_000
"""Splats of moved instances that are looked at in one frame."""


class EditorSession:
    """One open document and the user's view of it. All methods run on the UI's thread."""

    def __init__(self, wake: Callable[[], None] = lambda: None) -> None:
        """`wake` is called from other threads when they have something to show; a window sets its own."""
        self.wake = wake
        self.state = EditorState()
        self.messages = Messages()
        self.jobs = Jobs(self.messages.error, lambda: self.wake(), self.messages.info)
        self.actions = ActionRegistry()
        self.document: Document | None = None
        self.jumping = HistoryController()
        context = SessionContext(self.state, lambda: self.document, self.apply, self.jobs, self.messages)
        self.navigation = Navigation(context)
        self.autosave = Autosave(self.messages.error)
        self.files = DocumentFiles(self.jobs, self.messages, self.autosave, self.enter)
        self.exporting = ExportController(context, self.files)
        self.references = ReferencePictures(self.messages.error, lambda: self.wake())
        self.labels = LabelController(context)
        self.borders = SelectionBorder(context)
        self.solo = SoloController(context)
        self.moving = MoveController(context)
        self.aftermath = DeletionReview(context)
        self.turning = TurnController(context, self.navigation, turned=self.aftermath.clear)
        self.inserting = InsertController(context, self.moving)
        self.dialog: str | None = None
        """Name of the dialog to open in the next frame."""
        self.asked_about: tuple[int, ...] = ()
        """The instances that the dialog is about."""
        self.renamed: int = 0
        """The instance whose name the user wants to change: the list takes it, else the rename dialog; 0 = none."""
        self.recolor_mode: RecolorMode = "tint"
        self.recolor_color: tuple[float, float, float] = (0.82, 0.13, 0.13)
        """What the inspector's colour picker holds."""
        self.findings: tuple[Defect, ...] = ()
        """What was odd about the splats of the scene opened last."""
        self.waiting: Callable[[], None] | None = None
        """What the user wants to do next, while asked about unsaved changes."""
        self.panel: str | None = None
        """Name of the panel to bring to the front in the next frame."""
        self.dropped: tuple[Path, ...] = ()
        """Files dropped onto the window, to be taken up in the next frame."""
        self.quitting = False
        self._moved: tuple[int, int] | None = None
        """What had moved in the frame before."""

    def enter(self, opened: OpenedDocument) -> None:
        """Show what was opened from a file, as it was looked at when it was saved."""
        self.show(opened.document, opened.path, saved=opened.restored is None)
        self.autosave.follow(opened.document, opened.path, opened.restored)
        if opened.view is not None:
            restore_view(opened.view, self.state, self.navigation, len(opened.document.scene.views))
        for note in opened.notes:
            self.messages.info(note)
        self.findings = opened.findings
        harmful = any(finding.kind in HARMFUL for finding in opened.findings)
        if harmful and not opened.document.history.edits:
            self.dialog = "findings"

    def show(self, document: Document, path: Path | None = None, saved: bool = True) -> None:
        """Make a document the one that is edited; where it was recovered, its file lacks something: not `saved`."""
        scene = document.scene
        self.jumping.stop()
        self.document = document
        document.can_defer_bounds = True
        self.files.entered(document, path, saved)
        self.state.hovered = 0
        self.references.forget()
        self.navigation.enter(document)
        name = path.name if path else "the scene"
        # Where there are no instances, a region would select nothing.
        self.state.region_splats = len(scene.table) == 0
        instances = f", {format_count(len(scene.table), 'instance')}" if len(scene.table) else ""
        self.messages.info(f"Opened {name}: {format_count(len(scene), 'splat')}{instances}")
        self.turning.enter(document, stated_up(path) if path else None)

    @property
    def is_unsaved(self) -> bool:
        """Whether something would be lost if the document were closed."""
        return self.document is not None and self.files.is_unsaved(self.document)

    def leave(self, then: Callable[[], None]) -> None:
        """Do what closes the document, `then`; where changes are unsaved the user is asked first."""
        if self.is_unsaved:
            self.waiting, self.dialog = then, "unsaved"
        else:
            then()

    def offer_recovery(self) -> None:
        """Ask about work that editors have left that ended without saving; the answer may come frames later."""

        def ask() -> None:
            self.dialog = "recovery"

        self.files.find_recoverable(ask)

    def recover(self, session: RecoverableSession) -> None:
        """Go on with what a dead editor has left."""
        self.leave(lambda: self.files.recover(session))

    def quit(self) -> None:
        """Close the window."""
        self.quitting = True

    def save(self, path: Path | None = None, then: Callable[[], None] = lambda: None) -> None:
        """Save the project, to its file where no path is given; then do what was waiting."""
        path = path or self.files.project
        if self.document is not None and path is not None:
            self.files.save(self.document, path, view_as_json(self.state), then)

    def export(self, path: Path) -> None:
        """Write the whole edited scene: a file holds the shown moment, a folder keeps the tracks."""
        self.exporting.export(path, ExportChoice())

    def apply(self, make: Callable[..., Edit], *parameters: object, gesture: str | None = None) -> bool:
        """Make an edit and do it; returns whether it was done. What hinders it is told to the user."""
        if self.document is None:
            return False
        if self.jobs.blocking or self.jumping.under_way:
            self.messages.error("Please wait until the work under way is done")
            return False
        try:
            self.document.apply(make(*parameters), gesture)
        except EditError as error:
            self.messages.error(user_message(error))
            return False
        return True

    def undo(self) -> None:
        """Undo one step."""
        if self.document is not None and not self.jobs.blocking:
            self.jumping.stop()
            self.document.undo()

    def redo(self) -> None:
        """Redo one step."""
        if self.document is not None and not self.jobs.blocking:
            self.jumping.stop()
            self.document.redo()

    def jump(self, cursor: int) -> None:
        """Undo or redo until `cursor` edits are done: a few at once, more of them in the frames that follow."""
        if self.document is not None and not self.jobs.blocking:
            self.jumping.to(self.document, cursor)

    @property
    def selected(self) -> tuple[int, ...]:
        """IDs of the selected instances."""
        return self.document.find_selected_instances() if self.document else ()

    @property
    def locked(self) -> tuple[int, ...]:
        """IDs of the instances with any locked splat."""
        if self.document is None:
            return ()
        counts = self.document.count_states()
        return tuple(counts.ids[counts.locked > 0].tolist())

    @property
    def has_selection(self) -> bool:
        """Whether any splat is selected, of an instance or of none."""
        return self.document is not None and bool(self.document.state.mask(Flag.SELECTED).any())

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

    def select_class(self, class_name: str, mode: SelectMode = "replace") -> None:
        """Select all instances of a class; empty = those that have none."""
        self.apply(SelectClass, class_name, mode)

    def select_codeword_of(self, instance: int) -> None:
        """Select all splats that share an instance's codeword."""
        if self.document is not None:
            self.apply(SelectCodeword, self.document.scene.table[instance].codeword)

    def clear_selection(self) -> None:
        """Select nothing."""
        if self.has_selection:
            self.apply(SelectNone)

    def delete(self, ids: tuple[int, ...]) -> None:
        """Delete instances."""
        if ids and self.apply(DeleteInstances, ids):
            self.aftermath.deleted(ids)
            if self.state.hovered in ids:
                self.state.hovered = 0

    def delete_selection(self) -> None:
        """Delete the selected splats, and no others of their instances."""
        if self._selects_whole_instances():
            self.delete(self.selected)
        elif self.document is not None and self.has_selection:
            rows = self.document.state.rows_with(Flag.SELECTED)
            if self.apply(DeleteSelected):
                self.aftermath.deleted_rows(rows)
                self.state.hovered = 0

    def _selects_whole_instances(self) -> bool:
        if self.document is None:
            return False
        counts = self.document.count_states()
        chosen = counts.selected > 0
        whole = (counts.selected == counts.count - counts.deleted)[chosen].all()
        alone = counts.selected.sum() == len(self.document.state.rows_with(Flag.SELECTED))
        return bool(chosen.any() and whole and alone)

    def hide(self, ids: tuple[int, ...], hidden: bool = True) -> None:
        """Hide instances or show them again."""
        if ids:
            self.apply(HideInstances, ids, hidden)

    def show_all(self) -> None:
        """Show everything that is hidden."""
        self.apply(ShowAll)

    def lock(self, ids: tuple[int, ...], locked: bool = True) -> None:
        """Protect instances from being selected and edited, or free them."""
        if ids:
            self.apply(LockInstances, ids, locked)

    def recolor(
        self, ids: tuple[int, ...], mode: RecolorMode, color: tuple[float, float, float], gesture: str | None = None
    ) -> None:
        """Give instances a colour; calls of one `gesture` become one step."""
        if ids:
            self.apply(RecolorInstances, ids, mode, color, gesture=gesture)

    def adjust(self, ids: tuple[int, ...], what: AdjustKind, amount: float, gesture: str | None = None) -> None:
        """Set one adjustment of instances' colours; calls of one `gesture` become one step."""
        if ids:
            self.apply(SetAdjustment, ids, what, amount, gesture=gesture)

    def reset_colors(self, ids: tuple[int, ...]) -> None:
        """Give instances their trained colours and opacities back."""
        if ids:
            self.apply(ResetColors, ids)

    def ask(self, dialog: str, ids: tuple[int, ...]) -> None:
        """Open a dialog that is about some instances."""
        self.dialog, self.asked_about = dialog, ids

    def ask_name(self, instance: int) -> None:
        """Let the user type another name for an instance."""
        self.renamed = instance

    def tick(self, seconds: float) -> None:
        """Once a frame, `seconds` after the last: deliver finished jobs, let the drive play."""
        self.jobs.poll()
        self.jumping.tick()
        self.autosave.tick()
        self.turning.tick()
        self._catch_up()
        self.navigation.tick(seconds)

    def _catch_up(self) -> None:
        """Bound what was moved, some of it in each frame, once nothing goes on moving."""
        document = self.document
        if document is None:
            return
        goes_on, self._moved = document.geometry_version != self._moved, document.geometry_version
        if document.deferred is not None:
            if not goes_on:
                document.run_deferred(CAUGHT_UP)
            self.wake()

    def close(self, by_choice: bool = True) -> None:
        """Wait for running work. Not `by_choice` (after a failure), the autosave stays for the next editor to offer."""
        self.jobs.close()
        self.references.close()
        if by_choice:
            self.autosave.end()
