"""Found tracks are written and read again, and a damaged file is told with its fault."""

import json
from dataclasses import replace

import numpy as np
import pytest
from box_street import box_clip, standing

from instdrive_core.errors import DataError
from instdrive_core.scene.track import Track
from instdrive_core.tracks.choice import with_tracks
from instdrive_core.tracks.finder import FoundTracks
from instdrive_core.tracks.track_file import FILE, read_track_file, write_track_file


@pytest.fixture(scope="module")
def clip():
    return box_clip([standing(8, 0)], steps=3, beams=4, azimuths=60)


@pytest.fixture(scope="module")
def found():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    poses[:, 0, 3] = 1, 2, 3
    track = Track("found-001", "Car", np.array([1.9, 4.6, 1.5]), np.array([0.0, 0.1, 0.2]), poses, moving=True)
    return FoundTracks((track,), ("a note",))


def test_what_is_written_is_read(tmp_path, clip, found):
    write_track_file(tmp_path / FILE, found, clip)
    again = read_track_file(tmp_path / FILE, clip)
    assert again.notes == found.notes
    assert again.tracks[0].id == "found-001"
    np.testing.assert_allclose(again.tracks[0].world_from_box, found.tracks[0].world_from_box, atol=1e-4)
    moved = read_track_file(tmp_path / FILE, replace(clip, origin=np.array([10.0, 0.0, 0.0])))
    np.testing.assert_allclose(moved.tracks[0].world_from_box[:, 0, 3], [-9, -8, -7], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda content: content.update(version=9), "version"),
        (lambda content: content.update(clip="other"), "'other'"),
        (lambda content: content.pop("tracks"), "tracks"),
        (lambda content: content["tracks"][0].update(times=[0, 0, 1]), "rise"),
        (lambda content: content["tracks"][0].update(poses=[[1, 2, 3]] * 3), "4"),
        (lambda content: content["tracks"][0].update(dimensions=[1, 0, 1]), "positive"),
        (lambda content: content["tracks"].append(content["tracks"][0]), "same id"),
    ],
)
def test_a_damaged_file_is_told(tmp_path, clip, found, change, problem):
    write_track_file(tmp_path / FILE, found, clip)
    content = json.loads((tmp_path / FILE).read_text())
    change(content)
    (tmp_path / FILE).write_text(json.dumps(content))
    with pytest.raises(DataError, match=problem):
        read_track_file(tmp_path / FILE, clip)


def test_training_takes_tracks_from_where_it_is_told(tmp_path, clip, found):
    write_track_file(tmp_path / FILE, found, clip)
    notes = []
    assert with_tracks(clip, None, tmp_path, notes.append).tracks[0].id == "found-001"
    assert notes == ["a note", "1 moving objects found in the LiDAR sweeps"]
    assert with_tracks(clip, "none", tmp_path).tracks == ()
    annotated = replace(clip, tracks=found.tracks)
    assert with_tracks(annotated, None, tmp_path / "none") is annotated
    with pytest.raises(DataError, match="no cuboids"):
        with_tracks(clip, "annotated", tmp_path)
    with pytest.raises(DataError, match="no LiDAR sweeps"):
        with_tracks(replace(clip, sweeps=()), "found", tmp_path)
