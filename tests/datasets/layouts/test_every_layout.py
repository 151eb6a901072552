"""Every layout that is written: a drive written and read back is the same drive."""

import numpy as np
import pytest
from small_clip import WHOLE, WRITTEN, record_small_clip, write_layout, write_small_clip

from instdrive_core.datasets.clip_comparison import compare_clips
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError


@pytest.fixture(params=WRITTEN)
def folder(request, tmp_path):
    """The small clip in a layout."""
    return write_layout(request.param, tmp_path / "clip")


@pytest.fixture
def original(tmp_path):
    """The small clip as it was."""
    return load_clip(str(write_small_clip(tmp_path / "first")), WHOLE)


def test_a_drive_written_and_read_back_is_the_same(folder, original):
    first = original
    second = load_clip(str(folder), WHOLE)
    found = compare_clips(first, second, tuple(zip(first.camera_names, second.camera_names, strict=False)))
    assert found.photos >= 5
    assert found.photos_equal
    assert found.pose_error < 1e-6
    assert found.lens_error < 1e-6
    assert found.points == 18
    assert found.point_error_m < 1e-3
    assert found.boxes == 10
    assert found.box_error_m < 0.01
    before = {track.label: track.moving for track in first.tracks}
    assert len(second.tracks) == len(first.tracks)
    assert sorted(track.moving for track in second.tracks) == sorted(track.moving for track in first.tracks), before


def test_intensities_and_times_stay_where_the_layout_has_them(folder):
    sweep = load_clip(str(folder), WHOLE).sweeps[0].load()
    np.testing.assert_allclose(sweep.intensity, 0.2, atol=0.01)
    assert sweep.times is None or np.ptp(sweep.times) < 1e-6


@pytest.mark.parametrize("title", WRITTEN)
def test_nothing_is_written_over(title, tmp_path):
    recording = record_small_clip(tmp_path / "source")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "something").touch()
    with pytest.raises(DataError, match="is not an empty folder"):
        WRITTEN[title].write(recording, tmp_path / "full")
