"""One request for each way in which a dialog of the window can be opened."""

from datetime import UTC, datetime

import numpy as np
from PIL import Image

from instdrive_app.session.requests import (
    AskChangedScene,
    AskClass,
    AskExport,
    AskFindObjects,
    AskImprove,
    AskLeaveJob,
    AskName,
    AskNewScene,
    AskOtherSave,
    AskPath,
    AskPreferences,
    AskReassign,
    AskRecord,
    AskSplit,
    AskTooLarge,
    AskUnsaved,
    AskUp,
    OfferCleanup,
    OfferJob,
    OfferRecovery,
    ReceiveDrop,
    ShowAbout,
    ShowPalette,
    ShowShortcuts,
    do_nothing,
)
from instdrive_core.errors import SceneTooLargeError
from instdrive_core.jobs.job_file import CurvePoint, JobRequest, JobStage, JobState, write_job_state
from instdrive_core.project.recoverable import RecoverableSession
from instdrive_core.scene.lint import Defect


def list_requests(scene, instance):
    """Requests by the names of their dialogs: about a scene file and one of its instances."""
    too_large = SceneTooLargeError(scene, 40_000_000, 2e10, 6e9, 4)
    return {
        "open": AskPath("open"),
        "insert": AskPath("insert"),
        "save": AskPath("save"),
        "export": AskExport(),
        "film": AskExport("film"),
        "record": AskRecord(),
        "improve": AskImprove(),
        "find objects": AskFindObjects(),
        "new scene": AskNewScene(),
        "leave job": AskLeaveJob(do_nothing),
        "unfinished job": OfferJob(scene.parent),
        "shortcuts": ShowShortcuts(),
        "preferences": AskPreferences(),
        "about": ShowAbout(),
        "palette": ShowPalette(),
        "unsaved": AskUnsaved(do_nothing),
        "cleanup": OfferCleanup(),
        "recovery": OfferRecovery(),
        "changed scene": AskChangedScene(f"{scene.name} has changed since these edits were made.", do_nothing),
        "other save": AskOtherSave(scene, do_nothing),
        "too large": AskTooLarge(scene, too_large),
        "split": AskSplit(instance),
        "turn upright": AskUp(),
        "class": AskClass((instance,)),
        "rename": AskName(instance),
        "reassign": AskReassign(),
        "dropped": ReceiveDrop((scene,)),
    }


def fill_in(session, scene):
    """Give the session what dialogs show that have nothing to show otherwise: defects, a path, work to recover."""
    not_finite = Defect(
        "not_finite",
        "3 splats hold values that are not finite (means of 2, log_scales of 3)",
        3,
        np.arange(3),
        "Best deleted: most viewers draw nothing or fail where one is in view",
    )
    session.making.run = scene.parent
    while len(session.camera_path.keys) < 2:
        session.camera_path.add()
    session.files.defects = (not_finite, Defect("far_outlier", "1 splat is far away", 1, np.arange(1), "Best deleted"))
    session.files.autosave.recoverable = [
        RecoverableSession(scene.parent, scene, datetime(2026, 5, 4, 12, 30, tzinfo=UTC), 12),
        RecoverableSession(scene.parent, scene.with_name("gone.ply"), datetime.now(UTC), 1, "gone.ply is gone"),
    ]


def write_example_job(run):
    """Write the state of a job that trains, as its process would, with every part that can be shown."""
    stages = (
        JobStage("poses", "Poses of the photos", "done", 1.0, 75.0),
        JobStage("train", "Training", "running", 0.4, 130.0),
        JobStage("eval", "Evaluation"),
    )
    curve = tuple(CurvePoint("rgb", 10 * n, 0.5 / (n + 1), 18.0 + 0.2 * n) for n in range(40))
    run.mkdir(parents=True, exist_ok=True)
    (run / "job").mkdir(exist_ok=True)
    note = "3 of 120 photos are left out: no pose was found for them. They are blurred, or show nothing of the rest"
    request = JobRequest(str(run.parent), 20.0)
    state = JobState(request, "running", stages, "Colour and shape", 200.0, 2_000, curve, (note,), "", 1)
    Image.fromarray(np.full((90, 320, 3), 128, np.uint8)).save(run / "job" / "picture.jpg")
    write_job_state(run, state)
