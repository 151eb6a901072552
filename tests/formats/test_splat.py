"""The .splat reader and writer: promised bounds, a file of another program, damaged files."""

import contextlib
import dataclasses
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from quantised_cases import hard_gaussians, rotation_angles
from random_scene import random_scene

from instdrive_core.errors import DataError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.splat import LOG_SCALE_LIMITS, read_splat, write_splat
from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.scene.scene import Scene, scene_from_gaussians

SHARES_A_FOLDER = [HealthCheck.function_scoped_fixture]


def static_scene(**options):
    return dataclasses.replace(random_scene(actors=0, **options), sky=None, views=())


@settings(max_examples=60, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(hard_gaussians())
def test_what_comes_back_is_within_the_promised_bounds(tmp_path, before):
    write_splat(tmp_path / "a.splat", scene_from_gaussians(before))
    after = read_splat(tmp_path / "a.splat").gaussians
    assert after.means.tobytes() == before.means.tobytes()
    np.testing.assert_allclose(after.log_scales, before.log_scales.clip(*LOG_SCALE_LIMITS), rtol=0, atol=4e-6)
    np.testing.assert_allclose(after.opacities, before.opacities, rtol=0, atol=1 / 510 + 2e-6)
    shown = (0.5 + Y0 * before.sh_dc).clip(0, 1)
    np.testing.assert_allclose(0.5 + Y0 * after.sh_dc, shown, rtol=0, atol=1 / 510 + 1e-6)
    assert rotation_angles(after.quats, before.quats).max() < 0.9
    assert after.sh_degree == 0


def test_a_record_stands_byte_for_byte_where_viewers_look(tmp_path):
    """Built by hand after the layout: nothing of the writer is used."""
    record = struct.pack("<6f", 1.5, -2.0, 3.25, 0.5, 1.0, 2.0) + bytes([255, 0, 51, 128, 192, 64, 128, 128])
    (tmp_path / "a.splat").write_bytes(record)
    gaussians = open_scene(tmp_path / "a.splat").gaussians
    np.testing.assert_array_equal(gaussians.means, [[1.5, -2.0, 3.25]])
    np.testing.assert_allclose(gaussians.scales, [[0.5, 1.0, 2.0]], rtol=1e-6)
    np.testing.assert_allclose(0.5 + Y0 * gaussians.sh_dc, [[1.0, 0.0, 0.2]], atol=1e-6)
    np.testing.assert_allclose(gaussians.opacities, [128 / 255], rtol=1e-5)
    np.testing.assert_allclose(gaussians.quats, [[0.5**0.5, -(0.5**0.5), 0, 0]], atol=1e-6)


def test_instances_and_sh_are_left_out(tmp_path):
    scene = static_scene(count=9000)
    save_scene(tmp_path / "A.SPLAT", scene)
    assert (tmp_path / "A.SPLAT").stat().st_size == 32 * 9000
    again = open_scene(tmp_path / "A.SPLAT")
    assert len(again) == 9000
    assert len(again.table) == 0
    assert not again.instance_ids.any()
    assert not again.extra


def test_positions_and_scales_that_are_no_numbers_are_kept(tmp_path):
    scene = static_scene(count=4)
    scene.gaussians.means[0] = [np.nan, np.inf, -np.inf]
    scene.gaussians.log_scales[1] = [np.nan, -np.inf, 0]
    write_splat(tmp_path / "a.splat", scene)
    again = read_splat(tmp_path / "a.splat").gaussians
    np.testing.assert_array_equal(again.means[0], [np.nan, np.inf, -np.inf])
    np.testing.assert_array_equal(again.log_scales[1], [np.nan, -np.inf, 0])


@pytest.mark.parametrize("name", ["sh_dc", "opacity_logits", "quats"])
def test_values_that_bytes_cannot_hold_are_refused(tmp_path, name):
    scene = static_scene(count=20)
    getattr(scene.gaussians, name)[17] = np.nan
    with pytest.raises(DataError, match="splat 17 is nan"):
        write_splat(tmp_path / "a.splat", scene)
    assert list(tmp_path.iterdir()) == []


def test_moving_and_empty_scenes_are_refused(tmp_path):
    with pytest.raises(DataError, match="2 actors that move"):
        save_scene(tmp_path / "a.splat", random_scene())
    with pytest.raises(DataError, match="no splats"):
        save_scene(tmp_path / "a.splat", static_scene(count=0))
    assert list(tmp_path.iterdir()) == []


def test_a_real_file_keeps_its_values(splat_files, tmp_path):
    scene = open_scene(splat_files / "luma-seal.splat")
    assert len(scene) == 101780
    save_scene(tmp_path / "a.splat", scene)
    theirs, ours = (np.fromfile(path, np.uint8) for path in (splat_files / "luma-seal.splat", tmp_path / "a.splat"))
    theirs, ours = theirs.reshape(-1, 32), ours.reshape(-1, 32)
    assert theirs[:, :12].tobytes() == ours[:, :12].tobytes()
    assert theirs[:, 24:28].tobytes() == ours[:, 24:28].tobytes()
    np.testing.assert_allclose(theirs[:, 12:24].copy().view("<f4"), ours[:, 12:24].copy().view("<f4"), rtol=4e-6)
    assert rotation_angles(ours[:, 28:] - 128.0, theirs[:, 28:] - 128.0).max() < 0.9


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (bytes(31), "31 bytes"),
        (bytes(64) + b"x", "65 bytes"),
        (b"ply\nformat ascii 1.0\n", "a .ply file"),
        (b"ply\n" + bytes(60), "a .ply file"),
        (b"\x1f\x8b" + bytes(33), ".spz"),
        (b"PK\x03\x04" + bytes(60), ".sog"),
        (struct.pack("<6f8B", 0, 0, 0, 1, -0.5, 1, *bytes(8)), "scale 1 of splat 0 is -0.5"),
    ],
)
def test_what_is_no_splat_file_is_explained(tmp_path, content, message):
    (tmp_path / "a.splat").write_bytes(content)
    with pytest.raises(DataError, match=message) as caught:
        open_scene(tmp_path / "a.splat")
    assert "a.splat" in str(caught.value)


@settings(max_examples=100, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(st.binary(max_size=200))
def test_any_bytes_open_or_explain_themselves(tmp_path, content):
    (tmp_path / "a.splat").write_bytes(content)
    with contextlib.suppress(DataError):
        scene = read_splat(tmp_path / "a.splat")
        assert isinstance(scene, Scene)
        assert len(scene) == len(content) / 32
