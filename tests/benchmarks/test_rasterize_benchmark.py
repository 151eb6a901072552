"""The speed measurement that `make bench` runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import workload
from benchmarks.rasterize import Options, main
from instdrive_core.errors import DataError, OptionError


def test_it_prints_one_json_line(
    capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not workload.SCRIPT.is_file():
        pytest.skip(f"the shared workload script is not at {workload.SCRIPT}")
    monkeypatch.setattr(workload, "CACHE", tmp_path)
    monkeypatch.setitem(workload.SIZES, "W1", (800, 64, 48))
    main(Options(workload="W1", state="trained", runs=3))
    figures = json.loads(capsys.readouterr().out)
    times = ["forward_ms", "backward_ms", "total_ms"]
    shares = ["evaluations", "peak_rate", "share_forward"]
    assert list(figures) == ["workload", "state", "channels", "threads", *times, *shares]
    assert (figures["workload"], figures["state"], figures["channels"]) == ("W1", "trained", 11)
    assert 0 < figures["forward_ms"] < figures["total_ms"]
    expected = figures["evaluations"] / figures["forward_ms"] * 1e3 / figures["peak_rate"]
    assert figures["share_forward"] == pytest.approx(expected, rel=0.1, abs=1e-3)


def test_an_absent_or_unknown_workload_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workload, "CACHE", tmp_path)
    monkeypatch.setattr(workload, "SCRIPT", tmp_path / "street_workload.py")
    with pytest.raises(DataError, match=r"street_workload\.py: the workload script is missing"):
        workload.load_workload("W2", "init")
    with pytest.raises(OptionError, match="W1, W2, W3"):
        workload.load_workload("W9", "init")
