"""The command that opens the editor: what it refuses, and why."""

from pathlib import Path

import pytest

from instdrive_app.cli import edit as edit_command
from instdrive_app.cli.edit import ScaleError, edit
from instdrive_app.files import sample
from instdrive_app.shell.window import require_display
from instdrive_core.errors import InstDriveError


def test_missing_scenes_and_displays_are_explained(monkeypatch):
    monkeypatch.setattr(sample, "SAMPLE", "no_such_scene")
    with pytest.raises(InstDriveError, match="instdrive edit SCENE"):
        edit_command.edit()
    with pytest.raises(InstDriveError, match="no such file"):
        edit_command.edit(Path("missing.ply"))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InstDriveError, match="xvfb-run"):
        require_display()


@pytest.mark.parametrize("scale", [-1.0, 0.1, 50.0])
def test_scales_beyond_reason_are_refused(scale):
    with pytest.raises(ScaleError, match=f"--scale {scale:g}"):
        edit(scale=scale)
