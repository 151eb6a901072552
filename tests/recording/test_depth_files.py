"""Depth in metres is the same in either form, and in the recording of a drive."""

import sys

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.errors import DataError
from instdrive_core.extras import MissingExtraError
from instdrive_core.recording.depth_files import check_depth_format, encode_depth, read_depth
from instdrive_core.recording.drive import Drive
from instdrive_core.recording.plan import RecordOptions, plan_views
from instdrive_core.recording.record import record_drive

DEPTH = np.array([[0, 1.25, 65.5359], [1e-3, 123456.78, 7 / 3]], np.float32)


@pytest.mark.parametrize("form", ["npz", "exr"])
def test_depth_reads_back_as_it_was(form, tmp_path):
    pytest.importorskip("OpenEXR" if form == "exr" else "numpy")
    (tmp_path / f"07.{form}").write_bytes(encode_depth(DEPTH, form))
    np.testing.assert_array_equal(read_depth(tmp_path / "07"), DEPTH)
    (tmp_path / f"07.{form}").write_bytes(encode_depth(DEPTH, form)[:-20])
    with pytest.raises(DataError, match="depth cannot be read"):
        read_depth(tmp_path / "07")


def test_a_drive_is_recorded_with_openexr(tmp_path):
    library = pytest.importorskip("OpenEXR")
    scene = random_scene(count=200)
    scene.gaussians.log_scales[:] = -1.2
    drive = Drive(scene, plan_views(scene, RecordOptions(last=0)))
    record_drive(tmp_path / "npz", drive)
    exr = Drive(drive.scene, drive.views, depth_format="exr")
    record_drive(tmp_path / "exr", exr)
    files = sorted((tmp_path / "exr/depth").rglob("*.exr"))
    assert files
    assert not list((tmp_path / "exr/depth").rglob("*.npz"))
    for path in files:
        opened = library.File(str(path), separate_channels=True)
        assert opened.header()["compression"] == library.ZIP_COMPRESSION
        assert [(name, each.pixels.dtype) for name, each in opened.channels().items()] == [("Z", np.float32)]
        twin = tmp_path / "npz" / path.relative_to(tmp_path / "exr").with_suffix("")
        np.testing.assert_array_equal(read_depth(path.with_suffix("")), read_depth(twin))
    with pytest.raises(DataError, match="holds a recording"):
        record_drive(tmp_path / "exr", drive)


def test_without_openexr_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(MissingExtraError, match=r"instdrive\[exr\]"):
        check_depth_format("exr")
    check_depth_format("npz")
