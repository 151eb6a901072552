"""`instdrive doctor`: what it prints, and that it notices what does not work."""

import sys

import numpy as np
import pytest

from instdrive_app.cli import doctor as doctor_command
from instdrive_app.main import main
from instdrive_app.render import offscreen
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.scene import scene_from_gaussians


@pytest.fixture
def working_gl(gl):
    """Skips where there is no OpenGL; the command makes a context of its own."""


@pytest.fixture
def no_torch(monkeypatch):
    """Loading torch takes longer than all else that is tested here."""
    monkeypatch.setattr(doctor_command, "_describe_cuda", lambda: "not asked")


def test_a_working_machine(working_gl, capsys):
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    for word in (
        "instdrive:",
        "Python:",
        f"numpy {np.__version__}",
        "CPU render: works",
        "test render equals",
        "CUDA:",
    ):
        assert word in text
    assert "FAILED" not in text
    assert text.splitlines()[-1].startswith("All")


def test_a_display_that_does_not_open_is_told(no_torch, monkeypatch, capsys):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(doctor_command, "_check_opengl_render", lambda: "not asked")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    assert main(["doctor"]) == 0
    assert "needs a display, too" in capsys.readouterr().out
    monkeypatch.setattr("glfw.init", lambda: 0)
    monkeypatch.setenv("DISPLAY", ":77")
    assert main(["doctor"]) == 2
    out, err = capsys.readouterr()
    assert "display:    FAILED: :77 does not open" in out
    assert err == "instdrive doctor: display does not work\n"


def test_a_machine_without_opengl_is_told_so_and_the_rest_still_checked(no_torch, monkeypatch, capsys):
    def refuse(**options):
        raise Exception("libEGL.so not loaded")

    monkeypatch.setattr(offscreen.moderngl, "create_context", refuse)
    assert main(["doctor"]) == 2
    out, err = capsys.readouterr()
    assert "OpenGL:     FAILED: no OpenGL 3.3 context off screen (libEGL.so not loaded)" in out
    assert "CPU render: works" in out
    assert "CUDA:       not asked" in out
    assert err == "instdrive doctor: OpenGL does not work\n"


def test_one_missing_splat_is_noticed(no_torch, working_gl, monkeypatch, capsys):
    whole = offscreen.draw_blended

    def careless(context, document, snapshot):
        fewer = scene_from_gaussians(document.scene.gaussians.select(slice(1, None)))
        fewer.sky = document.scene.sky
        return whole(context, Document(fewer), snapshot)

    monkeypatch.setattr(offscreen, "draw_blended", careless)
    assert main(["doctor"]) == 2
    assert "differs from the CPU's" in capsys.readouterr().out


def test_every_splat_of_the_tested_scene_counts():
    scene, snapshot = doctor_command._create_test_scene(), doctor_command._create_snapshot()
    whole = doctor_command._render_on_cpu(scene, snapshot)
    for row in range(len(scene)):
        fewer = scene_from_gaussians(scene.gaussians.select(np.arange(len(scene)) != row))
        fewer.sky = scene.sky
        difference = np.abs(doctor_command._render_on_cpu(fewer, snapshot) - whole).mean()
        assert difference > 1.5 * doctor_command.LARGEST_MEAN_DIFFERENCE, row


def test_a_wrong_cpu_picture_and_a_bug_are_both_reported(no_torch, monkeypatch, capsys):
    monkeypatch.setattr(doctor_command, "_render_on_cpu", lambda scene, snapshot: np.zeros((120, 160, 4), np.float32))
    monkeypatch.setattr(doctor_command, "_check_opengl_render", lambda: 1 / 0)
    assert main(["doctor"]) == 2
    out, err = capsys.readouterr()
    assert "a splat of opacity 0.5 came out as" in out
    assert "FAILED: ZeroDivisionError" in out
    assert "CPU render does not work; OpenGL does not work" in err


def test_a_torch_that_does_not_load_is_no_failure_of_the_editor(monkeypatch, tmp_path):
    (tmp_path / "torch.py").write_text("raise OSError('libtorch_cpu.so: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name == "torch" or name.startswith("instdrive_core.training")]:
        monkeypatch.delitem(sys.modules, name)
    text = doctor_command._describe_cuda()
    assert "torch cannot be loaded" in text
    assert "the editor does not" in text


def test_the_row_of_the_gpu_table_is_named():
    """Whichever row it is: the line on CUDA has it, with or without a GPU."""
    from instdrive_core.training.backends.device import describe_cuda_row

    assert describe_cuda_row() in doctor_command._describe_cuda()
