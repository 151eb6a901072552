"""Objects of a bare scene are found in photos and masks, in the real window; one is clicked, and they are kept."""

import shutil

import pytest
from photographed_street import write_photographed_street
from window_driver import PATIENCE, editor_window

from instdrive_core.edits.kinds.labels.relabel_rows import RelabelRows
from instdrive_core.project.open import open_project


@pytest.mark.slow
@pytest.mark.gui
def test_objects_are_found_in_photos_and_kept_in_the_project(tmp_path):
    street = write_photographed_street(tmp_path)
    beside = shutil.copy(street.scene, street.photos / "street.ply")
    project = tmp_path / "street.instdrive"
    with editor_window(beside, tmp_path) as window:
        ask(window)
        window.wait_for_widget("find.found")  # the photos beside the scene are filled in
        window.click_widget("dialog.accept")
        window.wait_for_edit("Find objects")
        state = window.wait_for(lambda state: "found in the masks of" in state["messages"][-1], "what was found")
        assert len(state["visible"]) >= 8
        window.wait_for_widget("training.status.done")
        click_something(window)
        window.key("ctrl+z")
        window.key("ctrl+z")
        window.wait_for(lambda state: state["visible"] == [], "no instance after undo")
        window.key("ctrl+y")
        window.wait_for(lambda state: len(state["visible"]) >= 8, "the objects after redo")
        window.key("ctrl+shift+s")
        window.enter_path(project)
        window.wait_for(lambda state: not state["unsaved"], "the project to be saved", PATIENCE)
        assert window.quit() == 0
    document = open_project(project).document
    (edit,) = [edit for edit in document.history.done if not edit.selects_only]
    assert isinstance(edit, RelabelRows)
    assert len(document.scene.table) == len(edit.parts) >= 8


def ask(window):
    window.click_widget("menu Labels")
    window.click_widget("menu labels.find_objects")


def click_something(window):
    """Click here and there in the picture until one whole instance is selected."""
    left, top, right, bottom = window.wait_for_rect("picture")
    for across, down in ((0.5, 0.6), (0.6, 0.55), (0.4, 0.55), (0.75, 0.5), (0.25, 0.5), (0.5, 0.85)):
        window.click(left + across * (right - left), top + down * (bottom - top))
        if len(window.wait_until_calm()["selected"]) == 1:
            return
    raise AssertionError("nothing can be selected")
