"""The check of a GPU: to a clear end on any machine, and its measurements on the stand-in for gsplat."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from torch_splatting import backend_of

from benchmarks import gpu_check, gpu_rows
from benchmarks.gpu_check import FAILED, MEASURED, NOT_MEASURED, ROWS, check, main, read_result, run_row

ROOT = Path(__file__).resolve().parents[2]
SIZE, COUNT = (48, 32), 50


def check_with(tmp_path, results, total=600.0, seconds_a_row=1.0):
    """The report where rows end as in `results` (others: measured), and the names of those that ran."""
    now, ran = [0.0], []

    def run(name, seconds, environment):
        ran.append(name)
        now[0] += min(seconds, seconds_a_row)
        return dict(results.get(name, {"status": MEASURED}))

    report = check(tmp_path / "out.json", run, lambda: now[0], total)
    assert json.loads((tmp_path / "out.json").read_text()) == report
    assert list(report["rows"]) == [row.name for row in ROWS]
    return report, ran


@pytest.mark.skipif(torch.cuda.is_available(), reason="what a machine without a GPU does")
def test_without_a_gpu_it_comes_to_a_clear_end(tmp_path: Path) -> None:
    """The script itself, as a user calls it: two processes that import torch, hence some seconds."""
    out = tmp_path / "check.json"
    result = subprocess.run(
        ["sh", str(ROOT / "benchmarks" / "gpu_check.sh"), str(out)], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.endswith("2 measured, 0 failed, 8 not measured\n")
    rows = json.loads(out.read_text())["rows"]
    assert rows["opengl"]["status"] == MEASURED
    assert rows["machine"]["torch"] == torch.__version__
    for row in ROWS:
        if row.on_gpu:
            assert rows[row.name]["status"] == NOT_MEASURED
            assert rows[row.name]["reason"].startswith("no GPU: ")


def test_a_row_that_fails_ends_no_other(tmp_path):
    failing = {"status": FAILED, "reason": "out of memory"}
    report, ran = check_with(tmp_path, {"opengl": failing, "tests": failing, "steps_5m": failing})
    assert ran == [row.name for row in ROWS]
    assert [name for name, row in report["rows"].items() if row["status"] == FAILED] == ["opengl", "tests", "steps_5m"]


def test_rows_that_need_a_failed_one_say_so(tmp_path):
    report, ran = check_with(tmp_path, {"build": {"status": FAILED, "reason": "no nvcc"}})
    assert ran == ["machine", "opengl", "install", "build"]
    assert report["rows"]["gsplat_5m"]["reason"] == "the row 'build' comes first: no nvcc"
    report, ran = check_with(tmp_path, {"machine": {"status": FAILED, "reason": "no torch"}})
    assert ran == ["machine", "opengl"]
    assert report["rows"]["install"]["reason"] == "what this machine has is not known: see the row 'machine'"


def test_the_call_ends_in_time_and_names_what_found_none(tmp_path):
    report, ran = check_with(tmp_path, {}, total=100, seconds_a_row=1000)
    assert ran == ["machine", "opengl", "install"]
    assert report["seconds"] <= 100
    assert report["rows"]["build"] == {"status": NOT_MEASURED, "reason": "the time is up", "seconds": 0}


def test_steps_are_held_against_those_of_gsplats_trainer(tmp_path):
    times = {"steps_1m": 13.0, "gsplat_1m": 10.0, "steps_5m": 40.0}
    results = {name: {"status": MEASURED, "ms_per_step": time} for name, time in times.items()}
    report, _ = check_with(tmp_path, results | {"gsplat_5m": {"status": FAILED, "reason": "out of memory"}})
    assert (report["step_ratio_1m"], report["step_ratio_5m"]) == (1.3, None)


def test_processes_that_crash_babble_or_hang_are_failed_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    assert read_result(0, 'hello\n{"a": 1}\n', "warned") == {"status": MEASURED, "a": 1}
    assert read_result(1, "", "Traceback\nRuntimeError: no kernel") == {
        "status": FAILED,
        "reason": "exit status 1: RuntimeError: no kernel",
        "output": ["Traceback", "RuntimeError: no kernel"],
    }
    assert read_result(-9, "", "")["reason"] == "exit status -9: it said nothing"
    for output in ("", "done\n", "[1, 2]\n"):
        assert read_result(0, output, "")["reason"] == "its last line is no JSON object"
    monkeypatch.setattr(gpu_check, "ROOT", ROOT / "tests")
    assert run_row("machine", 0.0, {}) == {"status": FAILED, "reason": "not done within 0 s"}
    assert run_row("machine", 20, {})["reason"].startswith("exit status 1: ")


def test_a_report_that_cannot_be_written_is_told_before_the_first_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([str(tmp_path / "missing" / "out.json")])
    assert f"there is no folder {tmp_path / 'missing'}" in capsys.readouterr().err


def test_every_row_is_known():
    assert list(gpu_rows.ROWS) == [row.name for row in ROWS]
    assert sum(row.seconds for row in ROWS) > gpu_check.TOTAL_SECONDS, "else the total would bound nothing"


def test_a_resumed_run_is_compared_with_the_run_itself() -> None:
    figures = gpu_rows.resume_run(backend_of("like 1.6"), COUNT, SIZE)
    assert figures["loss_resumed"] == pytest.approx(figures["loss"], rel=1e-4)
    assert figures["goes_on"] == "cpu"


def test_our_steps_are_measured() -> None:
    figures = gpu_rows.measure_our_steps(backend_of("like 1.6"), COUNT, SIZE, steps=2)
    assert (figures["gaussians"], figures["photo"], figures["peak_gpu_mb"]) == (COUNT, "48x32", None)
    assert isinstance(figures["ms_per_step"], float)
    assert figures["ms_per_step"] > 0


def test_steps_of_gsplats_trainer_descend() -> None:
    """`rasterization` as gsplat has it, with a picture of one colour: what counts is that the step calls and learns."""
    seen = []

    def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, sh_degree, packed):
        assert [list(value.shape) for value in (means, quats, scales, opacities, colors, viewmats, Ks)] == [
            *([COUNT, 3], [COUNT, 4], [COUNT, 3], [COUNT], [COUNT, 16, 3], [1, 4, 4], [1, 3, 3])
        ]
        assert (sh_degree, packed) == (3, False)
        seen.append((float(scales.detach().min()), float(opacities.detach().max()), colors[0, 0].detach().clone()))
        everything = torch.stack([value.mean() for value in (means, quats, scales, opacities)]).sum()
        return (colors.mean(dim=(0, 1)) + 0 * everything).expand(1, height, width, 3), None, {}

    library = SimpleNamespace(rasterization=rasterization, __version__="1.6.0")
    figures = gpu_rows.measure_gsplat_steps(backend_of("like 1.6"), library, COUNT, SIZE, steps=2)
    assert len(seen) == 1 + 2 + 3, "warm-up, timed and profiled steps"
    assert all(low > 0 and high < 1 for low, high, _ in seen)
    assert not torch.equal(seen[0][2], seen[-1][2])
    assert (figures["gsplat"], figures["gaussians"]) == ("1.6.0", COUNT)
