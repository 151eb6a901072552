"""Logs of Argoverse 2: steps, poses between times, and damaged tables."""

import sys

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import feather
from small_clip import WHOLE, write_layout

from instdrive_app.main import main
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError


@pytest.fixture
def log(tmp_path):
    return write_layout("Argoverse 2", tmp_path / "clip")


def rewrite(file, edit):
    """Write a table again after `edit` has changed its columns, which are lists."""
    columns = feather.read_table(file, memory_map=False).to_pydict()
    edit(columns)
    feather.write_feather(pa.table(columns), str(file), compression="uncompressed")


def test_steps_are_sweeps_and_photos_far_from_any(log):
    clip = load_clip(str(log), WHOLE)
    assert sorted({frame.view.index for frame in clip.frames}) == [0, 1, 2, 3, 4]
    assert [sweep.index for sweep in clip.sweeps] == [0, 2, 4]
    assert clip.camera_names == ("ring_front_center", "ring_front_left")


def test_points_have_the_times_at_which_they_were_measured(log):
    file = sorted((log / "sensors" / "lidar").iterdir())[1]
    rewrite(file, lambda columns: columns.update(offset_ns=list(range(0, 6_000_000, 1_000_000))))
    clip = load_clip(str(log), WHOLE)
    np.testing.assert_allclose(clip.sweeps[1].load().times - clip.sweeps[1].time, np.arange(6) * 1e-3, atol=1e-6)


def test_a_pose_between_two_is_interpolated(log):
    poses = log / "city_SE3_egovehicle.feather"
    whole = load_clip(str(log), WHOLE)

    def drop(columns):
        times = sorted(columns["timestamp_ns"])
        kept = [row for row, time in enumerate(columns["timestamp_ns"]) if time not in times[3:6]]
        for name, values in columns.items():
            columns[name] = [values[row] for row in kept]

    rewrite(poses, drop)
    part = load_clip(str(log), WHOLE)
    places = [np.stack([f.view.camera.position + clip.origin for f in clip.frames]) for clip in (whole, part)]
    assert 0 < np.abs(places[0] - places[1]).max() < 0.1


@pytest.mark.parametrize(
    ("name", "edit", "problem"),
    [
        ("city_SE3_egovehicle.feather", lambda c: c.pop("qw"), "column 'qw' is missing"),
        ("city_SE3_egovehicle.feather", lambda c: c["qw"].__setitem__(0, 9.0), "row 0 is no rotation"),
        ("city_SE3_egovehicle.feather", lambda c: c["tx_m"].__setitem__(0, None), "'tx_m' has 1 empty rows"),
        ("city_SE3_egovehicle.feather", lambda c: c["tx_m"].__setitem__(0, np.inf), "not finite"),
        ("city_SE3_egovehicle.feather", lambda c: [v.clear() for v in c.values()], "holds no pose|no numbers|no whole"),
        ("annotations.feather", lambda c: c["length_m"].__setitem__(0, 0.0), "row 0 has the size"),
        ("annotations.feather", lambda c: c["timestamp_ns"].__setitem__(0, 7), "no pose at 7 ns"),
        ("annotations.feather", lambda c: c["track_uuid"].__setitem__(0, None), "None' in row 0, no text"),
        ("calibration/intrinsics.feather", lambda c: c["sensor_name"].__setitem__(0, "x"), "no row for the sensor"),
        ("calibration/intrinsics.feather", lambda c: c["fx_px"].__setitem__(0, -1.0), "first two positive"),
    ],
)
def test_damaged_tables_are_named(log, name, edit, problem):
    rewrite(log / name, edit)
    with pytest.raises(DataError, match=problem):
        load_clip(str(log), WHOLE)


def test_a_table_that_is_cut_off_is_refused(log):
    file = log / "annotations.feather"
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(DataError, match="no readable feather table"):
        load_clip(str(log), WHOLE)


def test_without_pyarrow_the_extra_that_brings_it_is_named(log, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["info", str(log)]) != 0
    assert "pip install 'instdrive[datasets]'" in capsys.readouterr().err
