"""The benchmark that writes a drive in every layout, on a drive of a few bytes and on one step of PandaSet 002."""

from small_clip import WRITTEN, write_small_clip

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
