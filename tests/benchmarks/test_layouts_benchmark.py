"""The benchmark that writes a drive in every layout, on a drive of a few bytes and on one step of PandaSet 002."""

from types import SimpleNamespace

from small_clip import WRITTEN, write_small_clip

from benchmarks import train_layout
from benchmarks.layouts import Options, measure_layouts


def check(found, titles):
    assert set(found["layouts"]) == set(titles)
    for title, entry in found["layouts"].items():
        assert entry["photos_equal"], title
        assert entry["photos"] > 0, title
        assert entry["pose_error"] <= 1e-6, title
        assert entry["point_error_m"] <= 1e-3, title
        assert entry["box_error_m"] <= 0.01, title
        assert entry["psnr_gap"] is None


def test_every_layout_keeps_a_small_drive(tmp_path):
    found = measure_layouts(Options(clip=write_small_clip(tmp_path / "clip"), steps=5))
    check(found, WRITTEN)
    assert all(entry["points"] == 18 and entry["boxes"] == 10 for entry in found["layouts"].values())


def test_layouts_keep_a_step_of_pandaset(pandaset_clip):
    found = measure_layouts(Options(clip=pandaset_clip, steps=1, layouts=("nuScenes", "Waymo")))
    check(found, ("nuScenes", "Waymo"))
    assert all(entry["points"] == 165_519 for entry in found["layouts"].values())


def test_the_gap_is_that_to_the_same_cameras_of_the_original(tmp_path, monkeypatch, capsys):
    trained = {}

    def train(request, on_event, on_note):
        trained[request.out] = request
        return request.out

    def evaluate(run):
        return SimpleNamespace(figures={"psnr": 20.0 if run.name.startswith("original") else 20.25})

    monkeypatch.setattr(train_layout, "run_training", train)
    monkeypatch.setattr(train_layout, "evaluate_run", evaluate)
    clip = write_small_clip(tmp_path / "clip")
    found = measure_layouts(Options(clip=clip, steps=5, layouts=("drivestudio", "KITTI raw"), train=True))
    assert [entry["psnr_gap"] for entry in found["layouts"].values()] == [0.25, 0.25]
    originals = [request.options for request in trained.values() if request.clip == clip]
    assert [asked.cameras for asked in originals] == ["front_camera,back_camera", "front_camera"]
    assert {(asked.first_frame, asked.last_frame) for asked in originals} == {(2, 6)}
    assert "KITTI raw: 20.250 dB, gap +0.250 dB" in capsys.readouterr().err
