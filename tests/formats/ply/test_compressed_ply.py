"""The .compressed.ply reader and writer: bounds, plyfile and a decoder splat by splat, real and damaged files."""

import contextlib
import dataclasses
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement
from quantised_cases import hard_gaussians, rotation_angles
from random_scene import random_gaussians, random_scene

from instdrive_core.errors import DataError
from instdrive_core.formats.ply.compressed import read_compressed_ply, write_compressed_ply
from instdrive_core.formats.ply.compressed_layout import BOUNDS
from instdrive_core.formats.ply.inria import write_ply
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.spatial_order import sort_spatially
from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.scene.scene import Scene, scene_from_gaussians

SHARES_A_FOLDER = [HealthCheck.function_scoped_fixture]
VECTOR_STEPS = np.array([2047, 1023, 2047])


def static_scene(**options):
    return dataclasses.replace(random_scene(actors=0, **options), sky=None, views=())


def chunk_extents(values):
    """(n, k): the extent of each row's chunk."""
    starts = np.arange(0, len(values), 256)
    extents = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
    return extents[np.arange(len(values)) // 256]


@settings(max_examples=60, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(hard_gaussians())
def test_what_comes_back_is_within_the_promised_bounds(tmp_path, gaussians):
    write_compressed_ply(tmp_path / "a.compressed.ply", scene_from_gaussians(gaussians))
    after = read_compressed_ply(tmp_path / "a.compressed.ply").gaussians
    before = gaussians.select(sort_spatially(gaussians.means, 256))

    def close(new, old, steps):
        old = old.astype(np.float64)
        # Bounds and values are float32: half a unit in the last place each, of the larger bound.
        rounding = 2**-22 * (np.abs(old).max(axis=0) + 1e-30)
        assert (np.abs(new - old) <= chunk_extents(old) / (2 * steps) * (1 + 1e-6) + rounding).all()

    close(after.means, before.means, VECTOR_STEPS)
    close(after.log_scales, before.log_scales.clip(-20, 20), VECTOR_STEPS)
    close(0.5 + Y0 * after.sh_dc.astype(np.float64), 0.5 + Y0 * before.sh_dc.astype(np.float64), 255)
    np.testing.assert_allclose(after.opacities, before.opacities, rtol=0, atol=1 / 510 + 2e-6)
    assert rotation_angles(after.quats, before.quats).max() < 0.28
    assert after.sh_rest.shape == before.sh_rest.shape
    near_limit = np.abs(before.sh_rest) > 4 - 1 / 32
    bound = np.where(near_limit, 1 / 32, 1 / 64) + 1e-6
    assert (np.abs(after.sh_rest - before.sh_rest.clip(-4, 4)) <= bound).all()


@pytest.mark.parametrize("degree", range(4))
def test_a_slow_decoder_reads_the_same_from_what_we_write(tmp_path, degree):
    save_scene(tmp_path / "a.compressed.ply", static_scene(count=300, degree=degree))
    ours = open_scene(tmp_path / "a.compressed.ply").gaussians
    ply = PlyData.read(str(tmp_path / "a.compressed.ply"))
    assert [element.name for element in ply.elements] == ["chunk", "vertex", *(["sh"] if degree else [])]
    assert ply["chunk"].count == 2
    assert tuple(entry.name for entry in ply["chunk"].properties) == BOUNDS
    for row in range(300):
        expected = decoded(ply, row)
        for name, value in expected.items():
            np.testing.assert_allclose(getattr(ours, name)[row], value, rtol=1e-5, atol=2e-6, err_msg=name)


def decoded(ply, row):
    """One splat after the format's description, with plain integers and floats."""
    vertex = {name: int(ply["vertex"][name][row]) for name in ("packed_position", "packed_rotation")}
    vertex |= {name: int(ply["vertex"][name][row]) for name in ("packed_scale", "packed_color")}
    chunk = {name: float(ply["chunk"][name][row // 256]) for name in BOUNDS}

    def between(name, unit):
        return chunk[f"min_{name}"] + unit * (chunk[f"max_{name}"] - chunk[f"min_{name}"])

    def three(word):
        return (word >> 21) / 2047, (word >> 11 & 1023) / 1023, (word & 2047) / 2047

    color = vertex["packed_color"]
    rotation = vertex["packed_rotation"]
    others = [((rotation >> shift & 1023) / 1023 - 0.5) * math.sqrt(2) for shift in (20, 10, 0)]
    others.insert(rotation >> 30, math.sqrt(1 - sum(value * value for value in others)))
    opacity = min(max((color & 255) / 255, 1e-6), 1 - 1e-6)
    result = {
        "means": [between(name, unit) for name, unit in zip("xyz", three(vertex["packed_position"]), strict=True)],
        "log_scales": [
            between(f"scale_{name}", unit) for name, unit in zip("xyz", three(vertex["packed_scale"]), strict=True)
        ],
        "sh_dc": [
            (between(name, (color >> shift & 255) / 255) - 0.5) / 0.28209479177387814
            for name, shift in (("r", 24), ("g", 16), ("b", 8))
        ],
        "opacity_logits": math.log(opacity / (1 - opacity)),
        "quats": others,
    }
    if "sh" in ply:
        stored = [int(ply["sh"][f"f_rest_{index}"][row]) for index in range(len(ply["sh"].properties))]
        values = [-4 if byte == 0 else 4 if byte == 255 else (byte + 0.5) / 32 - 4 for byte in stored]
        result["sh_rest"] = np.reshape(values, (3, -1)).T
    return result


def test_instances_are_left_out_and_the_origin_is_kept(tmp_path):
    scene = static_scene(count=9000)
    save_scene(tmp_path / "a.COMPRESSED.ply", scene)
    assert b"packed_position" in (tmp_path / "a.COMPRESSED.ply").read_bytes()[:2000]
    again = open_scene(tmp_path / "a.COMPRESSED.ply")
    assert len(again) == 9000
    assert len(again.table) == 0
    assert not again.instance_ids.any()
    np.testing.assert_array_equal(again.origin, scene.origin)
    save_scene(tmp_path / "plain.ply", again)
    assert open_scene(tmp_path / "plain.ply").gaussians.means.tobytes() == again.gaussians.means.tobytes()


def test_a_scene_without_splats_round_trips(tmp_path):
    save_scene(tmp_path / "a.compressed.ply", static_scene(count=0))
    assert len(open_scene(tmp_path / "a.compressed.ply")) == 0


def test_near_splats_share_a_chunk_whatever_their_order(tmp_path):
    """A street of 400 m with sky splats at 5 km: the median error stays far below what the scene's box would give."""
    rng = np.random.default_rng(0)
    gaussians = random_gaussians(rng, 20_000, 0)
    gaussians.means = rng.uniform([-200, -20, 0], [200, 20, 10], (20_000, 3)).astype(np.float32)
    gaussians.means[:200] = rng.normal(size=(200, 3)) * 5000
    before = gaussians.select(sort_spatially(gaussians.means, 256))
    write_compressed_ply(tmp_path / "a.compressed.ply", scene_from_gaussians(gaussians))
    after = read_compressed_ply(tmp_path / "a.compressed.ply").gaussians
    errors = np.linalg.norm(after.means - before.means, axis=1)
    assert np.median(errors) < 0.02
    assert sorted(map(bytes, before.means)) == sorted(map(bytes, gaussians.means))


def test_a_second_save_changes_next_to_nothing(tmp_path):
    write_compressed_ply(tmp_path / "a.compressed.ply", static_scene(count=5000, degree=2))
    first = read_compressed_ply(tmp_path / "a.compressed.ply")
    write_compressed_ply(tmp_path / "b.compressed.ply", first)
    second = read_compressed_ply(tmp_path / "b.compressed.ply")
    assert second.gaussians.sh_rest.tobytes() == first.gaussians.sh_rest.tobytes()
    for name in ("means", "log_scales", "opacity_logits", "sh_dc"):
        np.testing.assert_allclose(
            getattr(second.gaussians, name), getattr(first.gaussians, name), rtol=1e-6, atol=1e-6, err_msg=name
        )
    angles = rotation_angles(second.gaussians.quats, first.gaussians.quats)
    # Where two components are nearly as large, the other one can be the largest after rounding.
    assert np.quantile(angles, 0.99) < 0.001
    assert angles.max() < 0.28


@pytest.mark.parametrize(("name", "count"), [("biker.compressed.ply", 152746), ("guitar.compressed.ply", 90854)])
def test_real_files_keep_their_chunks_and_words(splat_files, tmp_path, name, count):
    save_scene(tmp_path / name, open_scene(splat_files / name))
    theirs, ours = (PlyData.read(str(folder / name)) for folder in (splat_files, tmp_path))
    assert ours["vertex"].count == count
    for bound in BOUNDS:
        np.testing.assert_allclose(ours["chunk"][bound], theirs["chunk"][bound], rtol=0, atol=1e-6)
    for word in ("packed_position", "packed_scale", "packed_color"):
        np.testing.assert_array_equal(ours["vertex"][word], theirs["vertex"][word], err_msg=word)


def test_reading_needs_little_beyond_the_result(tmp_path):
    count = 60_000
    save_scene(tmp_path / "a.compressed.ply", static_scene(count=count))
    size = (tmp_path / "a.compressed.ply").stat().st_size
    tracemalloc.start()
    scene = open_scene(tmp_path / "a.compressed.ply")
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(scene) == count
    assert peak - kept < 1.5 * size


@pytest.mark.parametrize("name", ["means", "sh_dc", "opacity_logits", "quats", "log_scales", "sh_rest"])
def test_values_that_words_cannot_hold_are_refused(tmp_path, name):
    scene = static_scene(count=9000)
    getattr(scene.gaussians, name)[8500] = np.nan
    with pytest.raises(DataError, match="splat 8500 is nan"):
        save_scene(tmp_path / "a.compressed.ply", scene)
    assert list(tmp_path.iterdir()) == []


def test_moving_scenes_are_refused(tmp_path):
    with pytest.raises(DataError, match="2 actors that move"):
        save_scene(tmp_path / "a.compressed.ply", random_scene())


# Files of other programs and files that are wrong


@pytest.fixture
def packed(tmp_path):
    path = tmp_path / "packed.compressed.ply"
    write_compressed_ply(path, static_scene(count=300, degree=1))
    return path


def rewritten(path, change, order="<"):
    """The file with its plyfile elements (name → rows) changed."""
    elements = {element.name: element.data for element in PlyData.read(str(path), mmap=False).elements}
    change(elements)
    described = [PlyElement.describe(rows, name) for name, rows in elements.items()]
    PlyData(described, byte_order=order).write(str(path))
    return read_compressed_ply(path)


def test_other_elements_and_columns_orders_and_byte_order_do_not_matter(packed):
    expected = read_compressed_ply(packed).gaussians

    def change(elements):
        vertex = elements.pop("vertex")
        names = [("note", "u1"), *((name, "u4") for name in reversed(vertex.dtype.names))]
        wider = np.zeros(len(vertex), names)
        for name in vertex.dtype.names:
            wider[name] = vertex[name]
        elements["camera"] = np.zeros(3, [("fov", "f8"), ("day", "u2")])
        elements["vertex"] = wider
        elements["face"] = np.array([([1, 2, 3],)], [("corners", "O")])

    again = rewritten(packed, change, ">").gaussians
    for name, array in expected.arrays().items():
        np.testing.assert_array_equal(getattr(again, name), array, err_msg=name)


def test_colours_of_the_first_versions_are_from_0_to_1(packed):
    ply = PlyData.read(str(packed))
    red = (ply["vertex"]["packed_color"] >> 24) / 255

    def change(elements):
        chunk = elements["chunk"]
        elements["chunk"] = chunk[list(BOUNDS[:12])].astype([(name, "f4") for name in BOUNDS[:12]])

    again = rewritten(packed, change).gaussians
    np.testing.assert_allclose(0.5 + Y0 * again.sh_dc[:, 0], red, atol=1e-6)


def test_bounds_that_are_no_numbers_are_kept_as_in_a_ply(packed):
    def change(elements):
        elements["chunk"]["min_x"][0] = np.nan
        elements["chunk"]["max_scale_y"][1] = np.inf

    again = rewritten(packed, change).gaussians
    assert np.isnan(again.means[:256, 0]).all()
    assert np.isfinite(again.means[256:]).all()
    assert not np.isfinite(again.log_scales[256:, 1]).any()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"ply\n", b"pli\n", "does not begin"),
        (b"element vertex 300", b"element vertex 301", "promises"),
        (b"element vertex 300", b"element vertex 299", "follow"),
        (b"element vertex 300", b"element vertex 999999999999999999", "promises"),
        (b"element chunk 2", b"element chunk 3", "promises"),
        (b"element chunk 2", b"element chunk 1", "follow"),
        (b"element sh 300", b"element sh 301", "promises"),
        (b"element sh 300", b"element vertex 300", "twice"),
        (b"element chunk 2", b"element chunks 2", "no chunk element"),
        (b"property float max_scale_x", b"property float other", "no max_scale_x"),
        (b"property float max_r", b"property int max_r", "not float"),
        (b"property uint packed_color", b"property int packed_color", "not uint"),
        (b"property uint packed_color", b"property uint other", "no packed_color"),
        (b"property uchar f_rest_8", b"property char f_rest_8", "not uchar"),
        (b"property uchar f_rest_8", b"property uchar other", "8 f_rest columns"),
        (b"property uchar f_rest_4", b"property uchar f_rest_9", "fit no SH degree"),
        (b"property float min_x", b"property list uchar float min_x", "list"),
        (b"binary_little_endian", b"ascii", "cannot be ASCII"),
        (b"end_header\n", b"", "end_header"),
    ],
)
def test_wrong_headers_are_explained(packed, old, new, message):
    content = packed.read_bytes()
    assert old in content
    packed.write_bytes(content.replace(old, new, 1))
    with pytest.raises(DataError, match=message) as caught:
        read_compressed_ply(packed)
    assert str(packed) in str(caught.value)


def test_counts_that_contradict_each_other_are_found(packed):
    def one_chunk_more(elements):
        elements["chunk"] = np.concatenate([elements["chunk"], elements["chunk"][:1]])

    def one_sh_row_less(elements):
        elements["sh"] = elements["sh"][1:]

    content = packed.read_bytes()
    with pytest.raises(DataError, match="3 chunks do not fit 300 splats"):
        rewritten(packed, one_chunk_more)
    packed.write_bytes(content)
    with pytest.raises(DataError, match="299 rows"):
        rewritten(packed, one_sh_row_less)


def test_a_plain_file_under_this_name_is_explained(tmp_path):
    write_ply(tmp_path / "a.compressed.ply", static_scene(count=3))
    with pytest.raises(DataError, match="Rename"):
        open_scene(tmp_path / "a.compressed.ply")


@settings(max_examples=100, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(st.data())
def test_damaged_files_open_or_explain_themselves(tmp_path, data):
    path = tmp_path / "a.compressed.ply"
    write_compressed_ply(path, static_scene(count=3, degree=1, features=0))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(content) - 1))
        match data.draw(st.sampled_from(["flip", "cut", "insert", "drop"])):
            case "flip":
                content[place] = data.draw(st.integers(0, 255))
            case "cut":
                del content[place + 1 :]
            case "insert":
                content[place:place] = data.draw(st.binary(min_size=1, max_size=9))
            case "drop":
                del content[place : place + data.draw(st.integers(1, 9))]
        content = content or bytearray(b"p")
    path.write_bytes(content)
    # Any other error, and any warning, fails.
    with contextlib.suppress(DataError):
        assert isinstance(read_compressed_ply(path), Scene)
