"""The benchmark that writes a drive in every layout, on a drive of a few bytes and on one step of PandaSet 002."""

import numpy as np
import pytest
import small_clip
from small_clip import WRITTEN, write_layout, write_small_clip

from benchmarks import train_layout
from benchmarks.layouts import Options, measure_layouts
from benchmarks.train_layout import PartOfDrive, measure_held_out_psnr, train_for_psnr
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import OptionError


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


@pytest.fixture
def trained(monkeypatch):
    """Nothing is trained: what would have been, and the pixels that would have been compared, by run."""
    trained = {}

    def train(part, runs, shown, seeds):
        trained[runs.name] = part, shown
        assert len(shown) == len(part.load().held_out_frames)
        return [20.0 + 0.25 * runs.name.startswith("layout") + 0.1 * seed for seed in range(seeds)]

    monkeypatch.setattr(train_layout, "train_for_psnr", train)
    return trained


def test_the_gap_is_that_to_the_same_cameras_of_the_original(tmp_path, trained, capsys):
    clip = write_layout("drivestudio", tmp_path / "clip")
    found = measure_layouts(Options(clip, steps=5, layouts=("T4", "KITTI raw"), train=True, iterations=30, seeds=2))
    assert [entry["psnr_gap"] for entry in found["layouts"].values()] == [0.25, 0.25]
    assert (found["width"], found["iterations"], found["seeds"]) == (64, 30, 2)
    assert [entry["psnr"] for entry in found["layouts"].values()] == [20.3, 20.3]
    assert [entry["psnr_noise"] for entry in found["layouts"].values()] == [0.1, 0.1]
    originals = [part for part, _ in trained.values() if part.path == clip]
    assert [part.options.cameras for part in originals] == ["camera_0", "camera_0,camera_1"]
    assert {(part.options.first_frame, part.options.last_frame) for part in originals} == {(0, 4)}
    assert {part.iterations for part, _ in trained.values()} == {30}
    assert "KITTI raw: 20.250, 20.350 dB, gap +0.250 dB" in capsys.readouterr().err


def test_layouts_are_measured_on_the_pixels_that_the_original_trains(tmp_path, trained, monkeypatch):
    """PandaSet's back camera shows the recording car; drivestudio's layout does not say so."""
    monkeypatch.setattr(small_clip, "STEPS", range(6))
    monkeypatch.setattr(small_clip, "LIDAR_STEPS", (0, 2))
    clip = write_small_clip(tmp_path / "clip")
    measure_layouts(Options(clip, steps=6, layouts=("drivestudio",), train=True))
    assert len(trained) == 2
    for _, (front, back) in trained.values():
        assert front is None
        assert back[:27].all()
        assert not back[27:].any()


def test_a_part_without_a_photo_to_measure_is_refused(tmp_path, trained):
    clip = write_small_clip(tmp_path / "clip")
    with pytest.raises(OptionError, match="no time step from 10 to 14 is held out; choose more --steps"):
        measure_layouts(Options(clip, steps=5, train=True))
    assert not trained


def test_training_is_measured_on_the_shown_pixels_of_held_out_photos(tmp_path):
    part = PartOfDrive(write_layout("drivestudio", tmp_path / "clip"), ClipOptions(), iterations=2)
    upper = np.zeros((36, 64), bool)
    upper[:9] = True
    (whole,) = train_for_psnr(part, tmp_path, (None, None))
    assert 5 < whole < 30
    assert measure_held_out_psnr(tmp_path / "0", part.load(), (upper, upper)) != pytest.approx(whole, abs=1e-3)
    assert measure_held_out_psnr(tmp_path / "0", part.load(), (None, upper | True)) == pytest.approx(whole)
