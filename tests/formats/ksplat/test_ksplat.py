"""The .ksplat: each level, buckets, sections of different degree, and headers that lie."""

import struct

import numpy as np
import pytest

from instdrive_core.errors import DataError
from instdrive_core.formats.ksplat.layout import HEADER_BYTES, LEVELS, SECTION_HEADER_BYTES
from instdrive_core.formats.ksplat.sample_files import BUCKET_SIZE, WIDTH, build_ksplat
from instdrive_core.formats.ksplat.scenes import read_ksplat
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc

COUNT = 2 * BUCKET_SIZE + 7


def build(level=1, sections=((COUNT, 2),)):
    return build_ksplat(np.random.default_rng(level), list(sections), level)


def save(folder, content):
    path = folder / "a.ksplat"
    path.write_bytes(content)
    return path


def records_of(content, level, degree=2, count=COUNT):
    """Splats of a file's only section; a file has room for three more."""
    record = LEVELS[level].describe_record(degree)
    return np.frombuffer(content[len(content) - (count + 3) * record.itemsize :], record)[:count]


@pytest.mark.parametrize("level", [0, 1, 2])
def test_every_level_is_read(tmp_path, level):
    content = build(level)
    found, stored = read_ksplat(save(tmp_path, content)).gaussians, records_of(content, level)
    np.testing.assert_allclose(np.exp(found.log_scales), stored["scale"].astype(float), rtol=1e-5)
    quats = stored["rotation"].astype(float)
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    np.testing.assert_allclose(found.quats, quats, atol=1e-6)
    np.testing.assert_allclose(color_from_dc(found.sh_dc), stored["color"][:, :3] / 255, atol=1e-6)
    np.testing.assert_allclose(sigmoid(found.opacity_logits), stored["color"][:, 3] / 255, atol=1e-6)
    harmonics = stored["harmonics"].astype(float)
    if level == 2:
        harmonics = -0.8 + harmonics / 255 * 1.7
    red, green_last = harmonics[:, :3], harmonics[:, 14:19]  # degree 1: rrrgggbbb; degree 2: five of each
    np.testing.assert_allclose(found.sh_rest[:, :3, 0], red, atol=1e-6)
    np.testing.assert_allclose(found.sh_rest[:, 3:, 1], green_last, atol=1e-6)


def test_positions_are_steps_from_the_middle_of_their_bucket(tmp_path):
    content = build(1)
    found, stored = read_ksplat(save(tmp_path, content)).gaussians, records_of(content, 1)
    start = HEADER_BYTES + SECTION_HEADER_BYTES
    lengths = np.frombuffer(content, "<u4", 2, start)
    middles = np.frombuffer(content, "<f4", 4 * 3, start + 8).reshape(4, 3)
    buckets = np.repeat(np.arange(4), [BUCKET_SIZE, BUCKET_SIZE, *lengths])
    expected = middles[buckets] + (stored["centre"].astype(float) - 32767) / 32767 * WIDTH / 2
    np.testing.assert_allclose(found.means, expected, atol=1e-5)


def test_sections_of_different_degree_are_one_scene(tmp_path):
    scene = read_ksplat(save(tmp_path, build(2, ((20, 2), (30, 0), (10, 1)))))
    rest = scene.gaussians.sh_rest
    assert rest.shape == (60, 8, 3)
    assert (rest[20:50] == 0).all()
    assert (rest[50:, :3] != 0).any()
    assert (rest[50:, 3:] == 0).all()


def change(content, place, kind, value):
    data = bytearray(content)
    struct.pack_into(kind, data, place, value)
    return bytes(data)


@pytest.mark.parametrize(
    ("place", "kind", "value", "said"),
    [
        (0, "<B", 1, r"version is 1\.1"),
        (20, "<H", 3, "compression level is 3"),
        (4, "<I", 1 << 30, "sections"),
        (4, "<I", 2, "at byte"),
        (16, "<I", 5, "promises 5 splats"),
        (36, "<f", 7.0, "range from 7 to 0.9"),
        (HEADER_BYTES + 4, "<I", 1 << 30, "ends at byte"),
        (HEADER_BYTES + 4, "<I", 3, "of at most 3"),
        (HEADER_BYTES + 8, "<I", 1, "buckets of a section hold"),
        (HEADER_BYTES + 16, "<f", float("nan"), "nan m wide"),
        (HEADER_BYTES + 40, "<H", 9, "SH degree 9"),
        (HEADER_BYTES + SECTION_HEADER_BYTES, "<I", 99, "buckets of a section hold"),
        (HEADER_BYTES + SECTION_HEADER_BYTES + 8, "<f", float("inf"), "is not finite"),
    ],
)
def test_headers_that_lie_are_refused(tmp_path, place, kind, value, said):
    path = save(tmp_path, change(build(1), place, kind, value))
    with pytest.raises(DataError, match=said) as caught:
        read_ksplat(path)
    assert caught.value.path == path


def test_a_scale_below_nothing_is_refused(tmp_path):
    content = build(0)
    start = HEADER_BYTES + SECTION_HEADER_BYTES
    with pytest.raises(DataError, match="below 0"):
        read_ksplat(save(tmp_path, change(content, start + 12, "<f", -1.0)))
