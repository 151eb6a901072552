"""NuRec's tracks and edits: what is written comes back, and what is damaged is named."""

import json
import zipfile

import numpy as np
import pytest
from drive import track

from instdrive_core.errors import DataError
from instdrive_core.formats.nurec.edit_assets import (
    AssetEdits,
    AssetFacts,
    Replacement,
    read_asset_edits,
    write_asset_edits,
)
from instdrive_core.formats.nurec.sequence_tracks import (
    SequenceTracks,
    read_sequence_tracks,
    write_sequence_tracks,
)

START = 1_700_000_000_000_000
BY_HAND = {
    "dummy_chunk_id": {
        "tracks_data": {
            "tracks_id": ["8"],
            "tracks_poses": [[[1, 2, 3, 0, 0, 0, 1], [2, 2, 3, 0, 0, 0.7071067811865476, 0.7071067811865476]]],
            "tracks_timestamps_us": [[1000000, 1100000]],
            "tracks_label_class": ["automobile"],
            "tracks_flags": [1],
        },
        "cuboidtracks_data": {"cuboids_dims": [[4.5, 2.0, 1.8]]},
    }
}


def assert_same_track(found, wanted):
    assert (found.id, found.label, found.moving) == (wanted.id, wanted.label, wanted.moving)
    np.testing.assert_allclose(found.dimensions, wanted.dimensions)
    np.testing.assert_allclose(found.world_from_box, wanted.world_from_box, atol=1e-12)


def test_tracks_come_back(tmp_path):
    written = (track("moving", -2.0, 20.0), track("parked", 2.5, 0.0))
    write_sequence_tracks(tmp_path / "tracks.json", SequenceTracks(written, START))
    found = read_sequence_tracks(tmp_path / "tracks.json")
    assert found.start == START + 300_000  # the first pose is at 0.3 s
    for mine, theirs in zip(written, found.tracks, strict=True):
        assert_same_track(theirs, mine)
        np.testing.assert_allclose(theirs.times, mine.times - 0.3, atol=1e-6)


@pytest.mark.parametrize("packed", [False, True])
def test_what_nurec_writes_is_read_in_its_axes(tmp_path, packed):
    """The box looks along the world's x at first, then along y; x of its size is the length."""
    file = tmp_path / ("last.usdz" if packed else "sequence_tracks.json")
    if packed:
        with zipfile.ZipFile(file, "w") as package:
            package.writestr("sequence_tracks.json", json.dumps(BY_HAND))
    else:
        file.write_text(json.dumps(BY_HAND["dummy_chunk_id"]))
    (car,) = read_sequence_tracks(file).tracks
    assert (car.id, car.label, car.moving) == ("8", "automobile", True)
    np.testing.assert_allclose(car.dimensions, [2.0, 4.5, 1.8])
    np.testing.assert_allclose(car.times, [0, 0.1])
    np.testing.assert_allclose(car.world_from_box[:, :3, 1], [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(car.world_from_box[:, :3, 3], [[1, 2, 3], [2, 2, 3]])


def test_edits_come_back(tmp_path):
    edits = AssetEdits(
        removed=("55",),
        replaced=(Replacement("23", "8", (4.5, 2.0, 1.8)), Replacement("30", "13")),
        inserted=(("18", track("car_18", 1.0, 3.0)),),
        assets=(AssetFacts("18", "car", (4.6, 2.0, 1.8)),),
        start=START,
    )
    write_asset_edits(tmp_path / "edit-assets.json", edits, "/data/last.usdz")
    content = json.loads((tmp_path / "edit-assets.json").read_text())
    assert set(content) == {"metadata", "replace", "remove", "insert"}
    assert content["replace"][1] == {"original_id": "30", "replacement_id": "13", "object_size": []}
    assert content["insert"]["data"]["cuboidtracks_data"]["cuboids_dims"] == [[4.0, 2.0, 1.5]]
    found = read_asset_edits(tmp_path / "edit-assets.json")
    assert (found.removed, found.replaced, found.assets) == (edits.removed, edits.replaced, edits.assets)
    ((asset, shown),) = found.inserted
    assert asset == "18"
    assert_same_track(shown, edits.inserted[0][1])


def test_no_edits_are_all_four_parts_and_come_back(tmp_path):
    write_asset_edits(tmp_path / "edit-assets.json", AssetEdits())
    assert read_asset_edits(tmp_path / "edit-assets.json") == AssetEdits()


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("tracks_id", ["8", "9"], "not of one length"),
        ("tracks_poses", [[[1, 2, 3, 0, 0, 0, 1]]], r"tracks_poses\[0\] is not 2 × 7"),
        ("tracks_poses", [[[1, 2, 3, 0, 0, 0, 0]] * 2], "quaternion of length 0"),
        ("tracks_timestamps_us", [[5, 5]], "does not rise"),
        ("tracks_label_class", None, "tracks_label_class is missing"),
    ],
)
def test_damaged_tracks_are_named(tmp_path, field, value, problem):
    content = json.loads(json.dumps(BY_HAND))
    content["dummy_chunk_id"]["tracks_data"][field] = value
    (tmp_path / "tracks.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=problem):
        read_sequence_tracks(tmp_path / "tracks.json")


def test_a_package_without_tracks_says_how_to_get_them(tmp_path):
    with zipfile.ZipFile(tmp_path / "last.usdz", "w") as package:
        package.writestr("default.usda", "#usda 1.0")
    with pytest.raises(DataError, match=r"sequence_tracks\.enabled=true"):
        read_sequence_tracks(tmp_path / "last.usdz")


@pytest.mark.parametrize("read", [read_asset_edits, read_sequence_tracks])
def test_missing_files_are_named(tmp_path, read):
    with pytest.raises(DataError, match=r"nowhere\.json.*cannot be read"):
        read(tmp_path / "nowhere.json")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"remove": None}, "remove is missing"),
        ({"remove": [True]}, r"remove\[0\]"),
        ({"replace": [{"original_id": "1"}]}, "replacement_id"),
        ({"replace": [{"original_id": "1", "replacement_id": "2", "object_size": [1, 2]}]}, "object_size"),
        ({"insert": {"asset_ids": ["1"], "data": {}}}, "1 entries, insert.data 0 tracks"),
    ],
)
def test_damaged_edits_are_named(tmp_path, change, problem):
    write_asset_edits(tmp_path / "edit-assets.json", AssetEdits())
    content = json.loads((tmp_path / "edit-assets.json").read_text()) | change
    (tmp_path / "edit-assets.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=problem):
        read_asset_edits(tmp_path / "edit-assets.json")
