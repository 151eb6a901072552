"""The dialog for new scenes: what a glance takes for a source, and the folder that it proposes."""

import pytest

from instdrive_app.panels.dialogs.making import job_fields, new_scene, source_field
from instdrive_app.panels.dialogs.making.new_scene import may_be_source


def test_videos_and_folders_with_files_may_be_sources(tmp_path):
    for name in ("walk.MP4", "notes.txt", "photos/1.jpg"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "empty").mkdir()
    names = ("walk.MP4", "notes.txt", "photos", "empty", "missing")
    assert [name for name in names if may_be_source(tmp_path / name)] == ["walk.MP4", "photos"]


@pytest.mark.parametrize(
    ("source", "taken", "expected"),
    [
        ("walk.mp4", (), "walk scene"),
        ("photos.2024", (), "photos.2024 scene"),
        ("photos.2024", ("photos.2024 scene",), "photos.2024 scene 2"),
    ],
)
def test_a_new_folder_is_proposed_among_the_documents(tmp_path, monkeypatch, source, taken, expected):
    monkeypatch.setattr(job_fields, "find_documents_folder", lambda: tmp_path)
    (tmp_path / "walk.mp4").touch()
    for name in taken:
        (tmp_path / name).mkdir()
    assert new_scene._propose_folder(tmp_path / source) == tmp_path / expected


def test_masks_come_first_and_cameras_last():
    facts = (("layout", "PandaSet"), ("  front", "2 photos"), ("LiDAR", "2 sweeps"), ("masks", "none"))
    assert [label for label, _ in source_field._order_facts(facts)] == ["masks", "layout", "LiDAR", "  front"]
