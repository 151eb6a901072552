"""Training's progress on a terminal and in a log."""

import io

from rich.console import Console

from instdrive_core.cli.train_progress import TrainProgress
from instdrive_core.training.settings.events import StageStarted, StepDone


def told(terminal: bool) -> str:
    out = io.StringIO()
    with TrainProgress(Console(file=out, force_terminal=terminal, width=160 if terminal else 60)) as progress:
        progress.on_note("reading a clip")
        progress.on_event(StageStarted("rgb", 0, 400))
        for step in range(10, 401, 10):
            progress.on_event(StepDone("rgb", step, 400, 0.5, 20.0, 12_345, step * 0.1, {"rgb": 0.5}))
        progress.on_event(StageStarted("instances", 0, 200, "caching weights"))
        progress.on_event(StepDone("instances", 200, 200, 0.25, None, 12_345, 60.0))
    return out.getvalue()


def test_a_log_gets_whole_lines_with_every_figure():
    lines = told(terminal=False).splitlines()
    assert "reading a clip" in lines
    assert "colour 200/400 · loss 0.5000 · PSNR 20.00 dB · 12,345 Gaussians · 10.0 it/s · 20 s left" in lines
    assert "caching weights" in lines
    assert any(line.startswith("instances 200/200 · loss 0.2500 · 12,345 Gaussians") for line in lines)


def test_a_terminal_gets_bars():
    shown = told(terminal=True)
    assert "400/400" in shown
    assert "\x1b[" in shown
