"""An edited scene trains on in the background and opens with its edits, without a terminal."""

import json
from dataclasses import replace

import psutil
import pytest
from window_driver import PATIENCE, editor_display, editor_window, start_editor
from written_street import TINY, copy_street

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.project.open import open_project
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, build_train_config

LONG_ENOUGH = "0.25"
"""Minutes, in which somebody can press Pause."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run of a small street."""
    folder = tmp_path_factory.mktemp("improve")
    copy_street(TINY, folder / "clip", tmp_path_factory)
    config = build_train_config("instdrive", "demo", seed=1)
    config = replace(
        config,
        init=InitConfig(lidar_points=2_500, near_points=200, far_points=200, actor_points=100),
        geometry=replace(config.geometry, iterations=60, coarse_iterations=4, sky_resolution=8),
        densify=replace(config.densify, max_gaussians=0),
    )
    request = RunRequest(folder / "clip", folder / "street", ClipOptions(cameras="1"), config)
    return run_training(request, lambda event: None, lambda note: None)


@pytest.mark.slow
@pytest.mark.gui
def test_an_edited_scene_trains_on_and_opens_with_edits_made_before_and_meanwhile(run, tmp_path):
    made = tmp_path / "better"
    with editor_window(run, tmp_path) as window:
        delete_improve_and_pause(window, made)
        select_something(window)
        window.key("h")
        window.wait_for_edit("Hide")
        kill_job(made)
        window.wait_for_widget("training.status.interrupted")
        window.click_widget("training.Resume")
        window.wait_for(
            lambda state: any("Opened better.instdrive" in text for text in state["messages"]), "its end", 3 * PATIENCE
        )
        state = window.wait_until_open()
        kinds = [title.split()[0] for title in window.state["history"]]
        assert [kind for kind in kinds if kind != "Select"] == ["Delete", "Hide"], state
        assert not window.state["unsaved"]
        window.key("ctrl+z")
        window.key("ctrl+z")
        window.wait_for(lambda state: state["unsaved"], "edits to be undone")
    assert json.loads((made / "run.json").read_text())["improved_from"] == str(run)
    document = open_project(made / "better.instdrive").document
    assert len(document.scene.views) > 0
    assert [type(edit).__name__ for edit in document.history.done if not edit.selects_only] == [
        "DeleteInstances",
        "HideInstances",
    ]


@pytest.mark.slow
@pytest.mark.gui
def test_a_job_goes_on_where_editor_and_job_were_killed(run, tmp_path):
    made = tmp_path / "better"
    with editor_display():
        window = start_editor(run, tmp_path, "first")
        try:
            delete_improve_and_pause(window, made)
            window.kill()
            kill_job(made)
        finally:
            window.close()
        window = start_editor(run, tmp_path, "second")
        try:
            window.click_widget("question.Go on")
            window.click_widget("recovery.0.recover")
            window.wait_for_edit("Delete")
            window.click_widget("question.Don't save")  # once it is done, before the improved scene takes its place
            window.wait_for_message("Opened better.instdrive")
            window.wait_until_open()
            assert [title.split()[0] for title in window.state["history"] if "elect" not in title] == ["Delete"]
            assert window.quit() == 0
        finally:
            window.close()


def delete_improve_and_pause(window, made):
    """Delete something, have the scene improved, and press Pause meanwhile."""
    select_something(window)
    window.key("Delete")
    window.wait_for_edit("Delete")
    window.click_widget("menu File")
    window.click_widget("menu file.improve")
    enter(window, "improve.minutes", LONG_ENOUGH)
    enter(window, "improve.out", str(made))
    window.click_widget("dialog.accept")
    window.wait_for_widget("training.status.running")
    window.click_widget("training.Pause")
    window.wait_for_widget("training.status.paused")


def kill_job(run):
    """End the job's process as a crash would, and wait until it is gone."""
    processes = [process for process in psutil.process_iter(["cmdline"]) if str(run) in (process.info["cmdline"] or ())]
    assert processes
    for process in processes:
        process.kill()
    psutil.wait_procs(processes, PATIENCE)


def enter(window, field, text):
    window.click_widget(field)
    window.key("ctrl+a")
    window.type(text)


def select_something(window):
    """Click here and there in the picture until something is selected."""
    left, top, right, bottom = window.wait_for_rect("picture")
    for across, down in ((0.5, 0.6), (0.75, 0.5), (0.25, 0.5), (0.5, 0.85), (0.3, 0.7), (0.7, 0.7)):
        window.click(left + across * (right - left), top + down * (bottom - top))
        if window.wait_until_calm()["selected"]:
            return
    raise AssertionError("nothing can be selected")
