"""Every panel, dialog, overlay and tool of the registries: has a title and an icon, and is drawn in the real window."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from example_requests import list_requests

from instdrive_app.panels.dialogs import DialogHost
from instdrive_app.panels.dialogs.registry import DIALOGS
from instdrive_app.panels.overlays.registry import OVERLAYS
from instdrive_app.panels.registry import PANELS
from instdrive_app.panels.widgets.ui import get_icon
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.window import EditorWindow
from instdrive_app.tools.registry import TOOLS

ROOT = Path(__file__).parents[3]
SUPPORT = ROOT / "tests" / "support"
REGISTRIES = {"panels": PANELS, "dialogs": DIALOGS, "overlays": OVERLAYS, "tools": TOOLS}


@pytest.mark.parametrize("records", REGISTRIES.values(), ids=REGISTRIES)
def test_every_record_has_a_title_of_its_own_and_an_icon(records):
    titles = [record.title for record in records]
    assert all(titles)
    assert len(set(titles)) == len(titles)
    for record in records:
        assert len(get_icon(record.icon)) == 1, record.title


def test_every_request_opens_one_dialog_and_has_an_example():
    host = DialogHost(DIALOGS)
    assert {type(request) for request in list_requests(Path("street.ply"), 1).values()} == host.answers
    with pytest.raises(ValueError, match="two dialogs answer"):
        DialogHost((*DIALOGS, DIALOGS[0]))


def test_the_window_menu_lists_the_panels():
    window = EditorWindow(EditorSession())
    listed = [(action.title, action.icon) for action in window.session.actions.in_menu("Window")]
    assert listed == [(record.title, record.icon) for record in PANELS if not record.fills_window]
    assert window.session.actions.menus[-1] == "Help"
    window.session.close()


@pytest.mark.slow
@pytest.mark.gui
def test_all_are_drawn_without_a_scene_and_with_the_street(tmp_path):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    command = [sys.executable, str(SUPPORT / "window/registry_tour.py"), str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{SUPPORT}"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-4000:]
