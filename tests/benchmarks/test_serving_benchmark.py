"""The benchmark of the server, on a small street."""

from parked_street import parked_street

from benchmarks.serving import measure_serving
from instdrive_core.formats.registry import save_scene


def test_pictures_and_sweeps_are_measured(tmp_path):
    save_scene(tmp_path / "street", parked_street().scene)
    found = measure_serving(tmp_path / "street", pictures=3, sweeps=1)
    assert 0 < found["serve_ms"] <= found["serve_worst_ms"] < 60_000
    assert found["serve_sweep_s"] > 0
    assert found["serve_splats"] > 10_000
    assert found["serve_size"] == "480x288"
