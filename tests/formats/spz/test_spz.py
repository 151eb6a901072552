"""The .spz reader and writer: bytes laid out by hand, promised bounds, files of other programs, damaged files."""

import contextlib
import gzip
import struct

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from quantised_cases import hard_gaussians, rotation_angles
from random_scene import random_gaussians, random_scene

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.formats.plausible_count import SMALL_COUNT
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.spz.scenes import write_spz
from instdrive_core.maths.spherical_harmonics import evaluate_rest_basis
from instdrive_core.scene.gaussians import create_empty_gaussians
from instdrive_core.scene.scene import scene_from_gaussians

SHARES_A_FOLDER = [HealthCheck.function_scoped_fixture]
HEADER = struct.Struct("<4sIIBBBBI12x")
SMALLEST_THREE = (0 << 30) | (511 << 20) | (0 << 10) | (1 << 9 | 511)
"""x left out, y = 0.707, z = 0, w = -0.707: x follows as 0."""


def hand_made(version, harmonics=bytes(range(120, 129)), degree=1):
    """One splat, laid out after the specification; nothing of the writer is used."""
    positions = struct.pack("<3e", 1.5, -2, 0.25)
    if version > 1:
        positions = b"".join(int(value * 4096).to_bytes(3, "little", signed=True) for value in (1.5, -2, 0.25))
    rotation = bytes([255, 128, 128]) if version < 3 else SMALLEST_THREE.to_bytes(4, "little")
    return {
        "header": (b"NGSP", version, 1, degree, 12, 0),
        "streams": [positions, bytes([51]), bytes([0, 255, 51]), bytes([0, 160, 255]), rotation, harmonics],
    }


def as_gzip(parts, more=b""):
    header = struct.pack("<4sIIBBBB", *parts["header"], 0)
    return gzip.compress(header + b"".join(parts["streams"]) + more)


def as_zstd(parts, records=b"", toc_start=None):
    frames = [zstandard.compress(stream) for stream in parts["streams"] if stream]
    toc = [struct.pack("<QQ", len(f), len(s)) for f, s in zip(frames, filter(None, parts["streams"]), strict=True)]
    start = 32 + len(records) if toc_start is None else toc_start
    return HEADER.pack(*parts["header"], len(frames), start) + records + b"".join(toc) + b"".join(frames)


def made(parts):
    return as_zstd(parts) if parts["header"][1] == 4 else as_gzip(parts)


def opened(tmp_path, content):
    (tmp_path / "a.spz").write_bytes(content)
    return open_scene(tmp_path / "a.spz").gaussians


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_every_version_is_read_as_the_format_says(tmp_path, version):
    gaussians = opened(tmp_path, made(hand_made(version)))
    np.testing.assert_allclose(gaussians.means, [[1.5, 2, -0.25]])
    np.testing.assert_allclose(gaussians.opacities, [0.2], rtol=1e-6)
    np.testing.assert_allclose(gaussians.sh_dc, [[-1 / 0.3, 1 / 0.3, -2]], rtol=1e-6)
    np.testing.assert_allclose(gaussians.log_scales, [[-10, 0, 5.9375]])
    expected = [0, 1, 0, 0] if version < 3 else [-(0.5**0.5), 0, -(0.5**0.5), 0]
    assert rotation_angles(gaussians.quats, np.array([expected], np.float32)).max() < 7.3
    # Coefficients of y, z, x: right stays, down and forward turn round.
    file = (np.arange(120, 129).reshape(3, 3) - 128) / 128
    np.testing.assert_allclose(gaussians.sh_rest[0], file * [[-1], [-1], [1]])


def test_the_turned_scene_looks_the_same_from_the_turned_direction(tmp_path):
    """Colour by direction from the raw bytes and axes of the file, against what was opened."""
    rng = np.random.default_rng(3)
    values = rng.integers(0, 256, 45).astype(np.uint8)
    gaussians = opened(tmp_path, made(hand_made(4, values.tobytes(), degree=3)))
    directions = rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    in_file = evaluate_rest_basis(directions, 15) @ ((values.reshape(15, 3) - 128.0) / 128)
    opened_colors = evaluate_rest_basis(directions * [1, -1, -1], 15) @ gaussians.sh_rest[0].astype(np.float64)
    np.testing.assert_allclose(opened_colors, in_file, atol=1e-6)


def test_positions_that_are_no_numbers_are_kept(tmp_path):
    """Half floats have them, signalling ones too, for which NumPy warns."""
    parts = hand_made(1)
    parts["streams"][0] = bytes([1, 0x7D, 0, 0x7C, 1, 0xFE])
    assert not np.isfinite(opened(tmp_path, made(parts)).means).any()


def test_sh_of_degree_4_is_read_as_degree_3_and_said_so(tmp_path, caplog):
    gaussians = opened(tmp_path, made(hand_made(4, bytes(range(72)), degree=4)))
    assert gaussians.sh_degree == 3
    np.testing.assert_allclose(np.abs(gaussians.sh_rest[0, 14]), (128 - np.arange(42, 45)) / 128)
    assert "degree 3" in caplog.text


@settings(max_examples=60, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(hard_gaussians(), st.sampled_from([1, 2, 3, 4]), st.sampled_from([(5, 4), (8, 8), (1, 1)]))
def test_what_comes_back_is_within_the_promised_bounds(tmp_path, before, version, bits):
    before.means.clip(-2000, 2000, out=before.means)
    write_spz(tmp_path / "a.spz", scene_from_gaussians(before), version, bits)
    after = open_scene(tmp_path / "a.spz").gaussians
    tolerance = {"rtol": 0, "atol": 0.000123} if version > 1 else {"rtol": 0.0005, "atol": 1e-7}
    np.testing.assert_allclose(after.means, before.means, **tolerance)
    np.testing.assert_allclose(after.log_scales, before.log_scales.clip(-10, 5.9375), rtol=0, atol=1 / 32 + 1e-6)
    np.testing.assert_allclose(after.opacities, before.opacities, rtol=0, atol=1 / 510 + 2e-6)
    np.testing.assert_allclose(after.sh_dc, before.sh_dc.clip(-0.5 / 0.15, 0.5 / 0.15), rtol=0, atol=0.0131)
    assert rotation_angles(after.quats, before.quats).max() < (0.3 if version > 2 else 14)
    bounds = {5: 0.036, 4: 0.067, 8: 0.004, 1: 0.505}
    wanted = before.sh_rest.clip(-1, 1)
    for name, rows, kept in (("degree 1", slice(0, 3), bits[0]), ("above", slice(3, None), bits[1])):
        atol = max(bounds[kept], 1 / 128 + 1e-6)
        np.testing.assert_allclose(after.sh_rest[:, rows], wanted[:, rows], rtol=0, atol=atol, err_msg=name)


@given(st.floats(2100, 8e6))
@example(2047.99)
@example(2048.01)
@settings(max_examples=15, deadline=None, suppress_health_check=SHARES_A_FOLDER)
def test_far_scenes_keep_whole_positions_with_wider_steps(tmp_path, extent):
    gaussians = random_gaussians(np.random.default_rng(0), 30, features=0)
    gaussians.means[0] = [extent, -extent, 0.3]
    write_spz(tmp_path / "a.spz", scene_from_gaussians(gaussians))
    after = open_scene(tmp_path / "a.spz").gaussians
    bound = 0.000123 * 2 ** np.ceil(np.log2(max(extent / 2047, 1)))
    np.testing.assert_allclose(after.means, gaussians.means, rtol=1e-7, atol=bound)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("degree", range(4))
def test_a_second_save_changes_nothing(tmp_path, version, degree):
    scene = scene_from_gaussians(random_gaussians(np.random.default_rng(1), 20_000, degree, features=0))
    write_spz(tmp_path / "a.spz", scene, version)
    again = open_scene(tmp_path / "a.spz")
    assert len(again) == len(scene)
    write_spz(tmp_path / "b.spz", again, version)
    third = open_scene(tmp_path / "b.spz").gaussians
    for name in ("means", "log_scales", "sh_dc", "sh_rest", "opacity_logits"):
        np.testing.assert_array_equal(getattr(third, name), getattr(again.gaussians, name), err_msg=name)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_a_scene_without_splats(tmp_path, version):
    write_spz(tmp_path / "a.spz", scene_from_gaussians(create_empty_gaussians(15)), version)
    again = open_scene(tmp_path / "a.spz")
    assert len(again) == 0
    assert again.gaussians.sh_degree == 3


@pytest.mark.parametrize("system", range(1, 9))
def test_other_axes_are_followed(tmp_path, system):
    parts = hand_made(4)
    parts["header"] = (*parts["header"][:-1], 2)
    records = struct.pack("<II3s", 0xADBE0002, 3, b"abc") + struct.pack("<III", 0xADBE0003, 4, system)
    bits = system - 1
    signs = np.array([1 if bits & 1 else -1, -1 if bits & 2 else 1, 1 if bits & 4 else -1])
    np.testing.assert_allclose(opened(tmp_path, as_zstd(parts, records)).means, [np.array([1.5, -2, 0.25]) * signs])
    legacy = hand_made(3)
    legacy["header"] = (*legacy["header"][:-1], 2)
    assert opened(tmp_path, as_gzip(legacy, records)).means.tolist() == [(np.array([1.5, -2, 0.25]) * signs).tolist()]


def test_biker_is_the_same_scene_in_both_of_its_formats(splat_files):
    """Rows stand in the same order, and only what the .spz rounds lies between them."""
    spz, ply = (open_scene(splat_files / name).gaussians for name in ("biker.spz", "biker.compressed.ply"))
    assert len(spz) == len(ply) == 152_746
    np.testing.assert_allclose(spz.means, ply.means, rtol=0, atol=0.000123)
    np.testing.assert_allclose(spz.log_scales, ply.log_scales.clip(-10, 5.9375), rtol=0, atol=1 / 32 + 1e-5)
    np.testing.assert_allclose(spz.opacities, ply.opacities, rtol=0, atol=3e-6)
    np.testing.assert_allclose(spz.sh_dc, ply.sh_dc, rtol=0, atol=0.0131)
    assert rotation_angles(spz.quats, ply.quats).max() < 0.3


@pytest.mark.parametrize("name", ["biker.spz", "train-1000.ply"])
def test_files_of_other_programs_round_trip(splat_files, tmp_path, name):
    scene = open_scene(splat_files / name)
    save_scene(tmp_path / "a.spz", scene)
    again = open_scene(tmp_path / "a.spz").gaussians
    np.testing.assert_allclose(again.means, scene.gaussians.means, rtol=0, atol=0.000123)
    np.testing.assert_allclose(again.opacities, scene.gaussians.opacities, rtol=0, atol=1 / 510 + 2e-6)
    assert again.sh_degree == scene.gaussians.sh_degree


def test_moving_actors_must_be_placed_first(tmp_path):
    scene = random_scene()
    with pytest.raises(DataError, match=r"2 actors that move.*--time"):
        save_scene(tmp_path / "a.spz", scene)
    placed = freeze_at_time(scene, 0.0)
    save_scene(tmp_path / "a.spz", placed)
    assert len(open_scene(tmp_path / "a.spz")) == len(placed)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("means", np.nan, "positions of splat 7 is nan"),
        ("means", np.inf, "positions of splat 7 is inf"),
        ("means", 9e6, "9e[+]06 m from the scene's origin"),
        ("quats", np.nan, "rotations of splat 7"),
        ("log_scales", np.nan, "scales of splat 7"),
        ("opacity_logits", np.nan, "alphas of splat 7"),
        ("sh_rest", np.nan, "harmonics of splat 7"),
    ],
)
def test_values_that_do_not_fit_leave_the_old_file(tmp_path, field, value, message):
    (tmp_path / "a.spz").write_bytes(b"old")
    gaussians = random_gaussians(np.random.default_rng(0), 20, features=0)
    getattr(gaussians, field)[7] = value
    with pytest.raises(DataError, match=message):
        save_scene(tmp_path / "a.spz", scene_from_gaussians(gaussians))
    assert [(entry.name, entry.read_bytes()) for entry in tmp_path.iterdir()] == [("a.spz", b"old")]


def test_infinite_opacities_and_flat_splats_are_cut_off(tmp_path):
    gaussians = random_gaussians(np.random.default_rng(0), 4, features=0)
    gaussians.opacity_logits[:2], gaussians.log_scales[2] = [np.inf, -np.inf], -np.inf
    save_scene(tmp_path / "a.spz", scene_from_gaussians(gaussians))
    again = open_scene(tmp_path / "a.spz").gaussians
    np.testing.assert_allclose(again.opacities[:2], [1, 0], atol=2e-6)
    np.testing.assert_array_equal(again.log_scales[2], -10)


def changed(version, index, value):
    parts = hand_made(version)
    parts["header"] = (*parts["header"][:index], value, *parts["header"][index + 1 :])
    return made(parts)


def with_stream(index, stream, promised=None):
    """A version 4 file with one frame that lies."""
    parts = hand_made(4)
    frames = [zstandard.compress(part) for part in parts["streams"]]
    frames[index] = zstandard.compress(stream)
    sizes = [len(part) for part in parts["streams"]]
    sizes[index] = promised or sizes[index]
    toc = [struct.pack("<QQ", len(frame), size) for frame, size in zip(frames, sizes, strict=True)]
    return HEADER.pack(*parts["header"], 6, 32) + b"".join(toc) + b"".join(frames)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "begins with b''"),
        (b"ply\nformat", "begins with b'ply"),
        (b"NGSP\4\0\0\0", "ends after 8 of the header's 32 bytes"),
        (b"\x1f\x8bnothing", "header. is damaged or cut off"),
        (gzip.compress(b"PLAY" + bytes(20)), "begins with"),
        (changed(4, 1, 5), "version is 5"),
        (HEADER.pack(b"NGSP", 3, 1, 0, 12, 0, 5, 32), "version is 3, not 4"),
        (changed(4, 2, 2), "positions promises 9 bytes, 2 splats have 18"),
        (changed(4, 2, 1 << 31), "2147483648 splats in"),
        (changed(3, 2, 1 << 31), "2147483648 splats in"),
        (changed(3, 2, 3), "ends after"),
        (changed(3, 2, 0), "more than 0 bytes follow the 0 splats"),
        (changed(4, 3, 5), "shDegree is 5"),
        (changed(4, 3, 0), "numStreams is 6, 5 attributes"),
        (changed(2, 4, 25), "fractionalBits is 25"),
        (as_zstd(hand_made(4), toc_start=33), "positions promises 7"),
        (as_zstd(hand_made(4), toc_start=2**31), "tocByteOffset is 2147483648"),
        (as_zstd(hand_made(4)) + b"x", "streams end at byte"),
        (as_zstd(hand_made(4))[:-1], "streams end at byte"),
        (as_gzip(hand_made(3))[:-1], "is damaged or cut off"),
        (as_gzip(hand_made(3), b"x"), "bytes follow"),
        (with_stream(0, bytes(8)), "positions unpacks to 8 bytes, not 9"),
        (with_stream(1, bytes(1 << 24)), "alphas unpacks to 16777216 bytes, not 1"),
        (with_stream(1, bytes(1 << 24), promised=1 << 24), "alphas promises 16777216 bytes"),
    ],
    ids=lambda value: value if isinstance(value, str) else "file",
)
def test_wrong_files_are_explained(tmp_path, content, message):
    (tmp_path / "a.spz").write_bytes(content)
    with pytest.raises(DataError, match=message):
        open_scene(tmp_path / "a.spz")


@pytest.mark.parametrize(
    ("records", "message"),
    [
        (struct.pack("<II", 7, 100) + b"short", "promises 100 bytes"),
        (b"\1\2\3", "cut off"),
        (struct.pack("<III", 0xADBE0003, 4, 12), "coordinate system 12"),
    ],
)
def test_wrong_extensions_are_explained(tmp_path, records, message):
    parts = hand_made(4)
    parts["header"] = (*parts["header"][:-1], 2)
    (tmp_path / "a.spz").write_bytes(as_zstd(parts, records))
    with pytest.raises(DataError, match=message):
        open_scene(tmp_path / "a.spz")


def test_a_bomb_is_not_unpacked_and_not_written(tmp_path):
    """A gzip stream of zeros passes every size check but that of what a scene can be."""
    count = 40 * SMALL_COUNT
    header = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 3, 12, 0, 0)
    with gzip.open(tmp_path / "a.spz", "wb", compresslevel=1) as file:
        file.write(header)
        for _ in range(4):
            file.write(bytes(1 << 20))
    with pytest.raises(DataError, match=f"{count} splats in"):
        open_scene(tmp_path / "a.spz")
    equal = random_gaussians(np.random.default_rng(0), 1, 0, features=0).select(
        np.zeros(SMALL_COUNT + 20_000, np.int64)
    )
    with pytest.raises(DataError, match="copies of few splats"):
        save_scene(tmp_path / "b.spz", scene_from_gaussians(equal))
    assert not (tmp_path / "b.spz").exists()


@settings(max_examples=150, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(st.data())
def test_damaged_files_open_or_explain_themselves(tmp_path, data):
    version, degree = data.draw(st.sampled_from([1, 2, 3, 4])), data.draw(st.sampled_from([0, 3]))
    scene = scene_from_gaussians(random_gaussians(np.random.default_rng(1), 40, degree, features=0))
    write_spz(tmp_path / "good.spz", scene, version)
    content = bytearray((tmp_path / "good.spz").read_bytes())
    if version < 4 and data.draw(st.booleans()):
        content = bytearray(gzip.decompress(content))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, min(len(content) - 1, 140)))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    if content[:4] == b"NGSP" and version < 4:
        content = gzip.compress(content)
    (tmp_path / "a.spz").write_bytes(content)
    with contextlib.suppress(DataError):
        again = open_scene(tmp_path / "a.spz")
        assert len(again) <= 40


@pytest.mark.parametrize("version", [3, 4])
def test_no_damage_to_the_content_passes_unseen(tmp_path, version):
    """Checksums: what this program wrote is read whole or not at all."""
    scene = scene_from_gaussians(random_gaussians(np.random.default_rng(1), 50, 1, features=0))
    write_spz(tmp_path / "good.spz", scene, version)
    content = (tmp_path / "good.spz").read_bytes()
    start = 32 + 6 * 16 if version == 4 else 10
    for place in range(start, len(content), 7):
        damaged = bytearray(content)
        damaged[place] ^= 0x10
        (tmp_path / "a.spz").write_bytes(damaged)
        with pytest.raises(DataError):
            open_scene(tmp_path / "a.spz")


def test_values_far_beyond_what_fits_are_cut_off(tmp_path):
    scene = random_scene(count=8, actors=0)
    scene.gaussians.sh_rest[0] = 3e38
    scene.gaussians.sh_rest[1] = -3e38
    save_scene(tmp_path / "a.spz", scene)
    read = open_scene(tmp_path / "a.spz").gaussians.sh_rest
    assert read[0].min() > 0.85
    assert read[1].max() < -0.85
