"""Opening, saving, exporting and quitting."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from instdrive_app.action import Action, MenuItem
from instdrive_app.actions.conditions import is_editable, put_request
from instdrive_app.files.sample import find_sample_scene, has_sample_scene
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.making.job_controller import REPORT
from instdrive_app.session.requests import AskExport, AskImprove, AskNewScene, AskPath, AskRecord, ShowPanel


def list_actions(session: EditorSession) -> list[Action]:
    """List the File menu."""
    return [
        *_list_opening(session),
        *_list_saving(session),
        *_list_exporting(session),
        *_list_runs(session),
        *_list_leaving(session),
    ]


def _list_opening(session: EditorSession) -> list[Action]:
    def list_recents() -> list[MenuItem]:
        return [(path.name, partial(session.files.leave_for, path)) for path in session.files.recents.paths]

    return [
        Action(
            "file.new",
            "New from photos, video or a drive…",
            put_request(session, AskNewScene()),
            "File",
            ("Ctrl+N",),
            icon="ICON_FA_WAND_MAGIC_SPARKLES",
            words=("train", "make", "capture", "reconstruct", "video", "photos"),
        ),
        Action(
            "file.improve",
            "Improve…",
            put_request(session, AskImprove()),
            "File",
            enabled=lambda: is_editable(session) and session.improver.base is not None,
            icon="ICON_FA_ARROW_TREND_UP",
            words=("train", "refine", "quality", "sharper", "more steps"),
            needs="The open scene is no run, so its photos are not known; open a run or a project on one",
            undoable=False,
        ),
        Action(
            "file.open", "Open…", put_request(session, AskPath("open")), "File", ("Ctrl+O",), icon="ICON_FA_FOLDER_OPEN"
        ),
        Action(
            "file.recent",
            "Open recent",
            put_request(session, AskPath("open")),
            "File",
            enabled=lambda: bool(session.files.recents.paths),
            icon="ICON_FA_CLOCK_ROTATE_LEFT",
            items=list_recents,
        ),
        Action(
            "file.sample",
            "Open the sample scene",
            lambda: session.files.leave_for(find_sample_scene()),
            "File",
            enabled=has_sample_scene,
            icon="ICON_FA_CITY",
        ),
        Action(
            "file.insert",
            "Insert scene…",
            put_request(session, AskPath("insert")),
            "File",
            ("Ctrl+Shift+I",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_FILE_IMPORT",
            undoable=True,
        ),
    ]


def _list_saving(session: EditorSession) -> list[Action]:
    def save() -> None:
        if session.files.project is None:
            session.requests.put(AskPath("save"))
        else:
            session.files.save()

    def can_save() -> bool:
        return is_editable(session) and session.files.path is not None

    return [
        Action(
            "file.save",
            "Save project",
            save,
            "File",
            ("Ctrl+S",),
            enabled=can_save,
            icon="ICON_FA_FLOPPY_DISK",
            undoable=False,
            separator=True,
        ),
        Action(
            "file.save_as",
            "Save project as…",
            put_request(session, AskPath("save")),
            "File",
            ("Ctrl+Shift+S",),
            enabled=can_save,
            icon="ICON_FA_FILE_PEN",
            undoable=False,
        ),
    ]


def _list_exporting(session: EditorSession) -> list[Action]:
    return [
        Action(
            "file.export",
            "Export…",
            put_request(session, AskExport()),
            "File",
            ("Ctrl+E",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_FILE_EXPORT",
            words=("screenshot", "picture", "image", "render", "mask", "save as ply"),
            undoable=False,
        ),
        Action(
            "file.export_selection",
            "Export selection…",
            put_request(session, AskExport("selection")),
            "File",
            ("Ctrl+Shift+E",),
            enabled=lambda: is_editable(session) and not session.selection.is_empty,
            icon="ICON_FA_ARROW_UP_RIGHT_FROM_SQUARE",
            words=("crop", "cut out"),
            undoable=False,
        ),
        Action(
            "file.record",
            "Record drive…",
            put_request(session, AskRecord()),
            "File",
            enabled=lambda: session.document is not None and bool(session.document.scene.views),
            icon="ICON_FA_VIDEO",
            words=("simulate", "sensor data", "pandaset", "nuscenes", "kitti", "coco", "depth", "ground truth"),
            needs="The scene has no photo cameras; open a run or a project on one",
            undoable=False,
        ),
    ]


def _list_runs(session: EditorSession) -> list[Action]:
    return [
        Action(
            "file.training",
            "Show training",
            put_request(session, ShowPanel("Training")),
            "File",
            enabled=lambda: session.making.run is not None,
            icon="ICON_FA_CHART_LINE",
            separator=True,
            needs="There is no training; begin one with New from photos, video or a drive",
        ),
        Action(
            "file.report",
            "Open the evaluation",
            lambda: session.making.open_page(find_report(session)),
            "File",
            enabled=lambda: find_report(session).is_file(),
            icon="ICON_FA_CHART_COLUMN",
            words=("report", "psnr", "measure"),
            needs="The open scene is no run that was evaluated",
        ),
        Action(
            "file.compare_runs",
            "Compare runs",
            put_request(session, ShowPanel("Runs")),
            "File",
            icon="ICON_FA_SCALE_BALANCED",
            words=("compare", "psnr", "table"),
        ),
    ]


def find_report(session: EditorSession) -> Path:
    """Locate the page of the evaluation of the open run; there may be none."""
    path = session.files.path
    return path / REPORT if path is not None else Path("no run", REPORT)


def _list_leaving(session: EditorSession) -> list[Action]:
    return [
        Action(
            "file.quit",
            "Quit",
            session.leave,
            "File",
            ("Ctrl+Q",),
            icon="ICON_FA_POWER_OFF",
            separator=True,
        ),
    ]
