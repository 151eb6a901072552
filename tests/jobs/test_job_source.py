"""What a folder or file is found to be that somebody wants a scene of."""

import numpy as np
import pytest
from PIL import Image
from small_clip import write_exact_labels, write_small_clip

from instdrive_core.errors import DataError
from instdrive_core.jobs import source as source_module
from instdrive_core.jobs.source import look_at_source
from instdrive_core.jobs.stages import plan_stages


def photos(folder, count):
    folder.mkdir()
    for number in range(count):
        Image.fromarray(np.full((12, 16, 3), number, np.uint8)).save(folder / f"{number:03d}.jpg")
    return folder


def stages_of(facts, evaluate=True):
    return [stage.name for stage in plan_stages(facts, evaluate)]


def test_a_data_set_is_told_with_its_photos_lidar_boxes_and_masks(tmp_path):
    found = look_at_source(write_small_clip(tmp_path / "clip"))
    texts = dict(found.facts)
    assert (found.kind, found.title, found.problem) == ("clip", "PandaSet clip", "")
    assert found.masks == "annotations"
    assert {"photos", "LiDAR", "boxes", "masks"} <= set(texts)
    assert texts["photos"].startswith("10 ")
    assert stages_of(found) == ["masks", "pace", "train", "eval"]
    assert stages_of(found, evaluate=False) == ["masks", "pace", "train"]


def test_exact_labels_are_preferred_to_boxes(tmp_path):
    found = look_at_source(write_exact_labels(write_small_clip(tmp_path / "clip")))
    assert found.masks == "exact"


def test_what_moves_is_looked_for_where_there_are_sweeps_and_no_boxes(tmp_path):
    clip = write_small_clip(tmp_path / "clip")
    for file in (clip / "annotations" / "cuboids").iterdir():
        file.unlink()
    (clip / "annotations" / "cuboids").rmdir()
    found = look_at_source(clip)
    assert found.finds_tracks
    assert "tracks" in stages_of(found)


def test_photos_need_poses_first(tmp_path, monkeypatch):
    monkeypatch.setattr(source_module, "find_missing", lambda *packages: "")
    found = look_at_source(photos(tmp_path / "walk", 30))
    assert (found.kind, found.problem) == ("photos", "")
    assert dict(found.facts)["photos"] == "30, the first of 16×12"
    assert stages_of(found)[:2] == ["prepare", "masks"]


def test_without_segment_anything_photos_get_no_masks(tmp_path, monkeypatch):
    monkeypatch.setattr(source_module, "find_missing", lambda *packages: "pip install" * ("transformers" in packages))
    found = look_at_source(photos(tmp_path / "walk", 30))
    assert found.masks == "none"
    assert "pip install" in dict(found.facts)["masks"]
    assert "masks" not in stages_of(found)


def test_a_missing_program_part_is_the_problem(tmp_path, monkeypatch):
    monkeypatch.setattr(source_module, "find_spec", lambda name: None if name == "pycolmap" else object())
    assert "instdrive[" in look_at_source(photos(tmp_path / "walk", 30)).problem


def test_too_few_photos_are_told(tmp_path):
    assert "2 photos" in look_at_source(photos(tmp_path / "walk", 2)).problem


def test_a_video_is_known_by_its_ending(tmp_path):
    (tmp_path / "drive.MP4").write_bytes(b"0" * 2_000_000)
    found = look_at_source(tmp_path / "drive.MP4")
    assert found.kind == "video"
    assert dict(found.facts)["video"] == "2.0 MB"


@pytest.mark.parametrize("name", ["empty", "missing", "notes.txt"])
def test_nothing_to_make_a_scene_of_is_told_with_what_would_do(tmp_path, name):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("no pictures")
    with pytest.raises(DataError, match="Choose a clip's folder"):
        look_at_source(tmp_path / name)
