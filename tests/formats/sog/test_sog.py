"""The SOG reader: scenes made by hand, promised bounds, a scene of another program, levels of detail, hostile files."""

import contextlib
import json
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from quantised_cases import rotation_angles
from random_scene import random_scene
from sog_files import (
    files_of,
    legacy_meta_of,
    meta_of,
    random_bytes,
    splat_image,
    webp,
    write_archive,
    write_folder,
)

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.formats.plausible_count import SMALL_COUNT
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.sog.levels import read_sog_folder

SHARES_A_FOLDER = [HealthCheck.function_scoped_fixture]


def small_scene(count=37, bands=2, seed=0, palette=70):
    rng = np.random.default_rng(seed)
    return random_bytes(rng, count, bands, palette), meta_of(rng, count, bands, palette)


def expected_position(content, meta, row, axis):
    """One coordinate, spelled out after the description."""
    step = content["means_l"][row, axis] + 256 * content["means_u"][row, axis]
    low, high = meta["means"]["mins"][axis], meta["means"]["maxs"][axis]
    value = low + (high - low) * step / 65535
    return np.sign(value) * (np.exp(abs(value)) - 1)


def expected_rotation(pixel):
    values = iter((component / 255 * 2 - 1) / np.sqrt(2) for component in pixel[:3])
    quat = [0.0 if index == pixel[3] - 252 else next(values) for index in range(4)]
    quat[pixel[3] - 252] = np.sqrt(max(0, 1 - sum(value**2 for value in quat)))
    return quat


@pytest.mark.parametrize("bands", range(4))
@pytest.mark.parametrize("place", ["archive", "deflated", "folder", "meta.json"])
def test_every_attribute_is_what_its_bytes_say(tmp_path, bands, place):
    content, meta = small_scene(bands=bands)
    files = files_of(content, meta)
    path = tmp_path / "scene.SOG"
    if place in ("archive", "deflated"):
        write_archive(path, files, zipfile.ZIP_STORED if place == "archive" else zipfile.ZIP_DEFLATED)
    else:
        path = tmp_path / "scene"
        write_folder(path, files)
        path = path if place == "folder" else path / "meta.json"
    gaussians = open_scene(path).gaussians
    assert len(gaussians) == 37
    for row in range(37):
        for axis in range(3):
            wanted = expected_position(content, meta, row, axis)
            np.testing.assert_allclose(gaussians.means[row, axis], wanted, rtol=1e-6, atol=1e-6)
    rotations = np.array([expected_rotation(pixel) for pixel in content["quats"]])
    assert rotation_angles(gaussians.quats, rotations).max() < 0.001
    scales, colors = (np.array(meta[name]["codebook"], np.float32) for name in ("scales", "sh0"))
    np.testing.assert_array_equal(gaussians.log_scales, scales[content["scales"]])
    np.testing.assert_array_equal(gaussians.sh_dc, colors[content["sh0"][:, :3]])
    np.testing.assert_allclose(gaussians.opacities, content["sh0"][:, 3] / 255, atol=2e-6)
    assert gaussians.sh_degree == bands
    if bands:
        values = np.array(meta["shN"]["codebook"], np.float32)
        np.testing.assert_array_equal(gaussians.sh_rest, values[content["entries"][content["labels"]]])


def test_the_first_version_is_read_by_its_ranges(tmp_path):
    content, meta = small_scene(bands=3, palette=64)
    write_archive(tmp_path / "a.sog", files_of(content, legacy_meta_of(meta)))
    gaussians = open_scene(tmp_path / "a.sog").gaussians
    np.testing.assert_allclose(gaussians.log_scales, [-9, -8, -7] + 10 * content["scales"] / 255, atol=1e-5)
    np.testing.assert_allclose(
        gaussians.sh_dc, [-1, -2, -3] + np.array([2, 4, 6]) * content["sh0"][:, :3] / 255, atol=1e-5
    )
    np.testing.assert_allclose(gaussians.opacity_logits, -6 + 12 * content["sh0"][:, 3] / 255, atol=1e-5)
    wanted = -0.5 + 1.25 * content["entries"][content["labels"]] / 255
    np.testing.assert_allclose(gaussians.sh_rest, wanted, atol=1e-6)


@settings(max_examples=40, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(st.integers(0, 2**32 - 1), st.integers(1, 300))
def test_packed_scenes_come_back_within_the_promised_bounds(tmp_path, seed, count):
    """Packed here by the description's formulas; rounding is all that is lost."""
    rng = np.random.default_rng(seed)
    content, meta = small_scene(count, 0, seed)
    means, quats = rng.normal(0, 10, (count, 3)), rng.normal(size=(count, 4))
    logarithms = np.sign(means) * np.log1p(np.abs(means))
    low, high = logarithms.min(axis=0), np.maximum(logarithms.max(axis=0), logarithms.min(axis=0) + 1e-6)
    steps = np.rint((logarithms - low) / (high - low) * 65535).astype(np.int64)
    content |= {"means_l": steps % 256, "means_u": steps // 256}
    meta["means"] |= {"mins": low.tolist(), "maxs": high.tolist()}
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    largest = np.argmax(np.abs(quats), axis=1)
    quats *= np.sign(quats[np.arange(count), largest])[:, None]
    others = np.array([np.delete(quat, index) for quat, index in zip(quats, largest, strict=True)])
    content["quats"] = np.column_stack([np.rint((others * np.sqrt(2) + 1) * 127.5), 252 + largest])
    write_archive(tmp_path / "a.sog", files_of(content, meta))
    gaussians = open_scene(tmp_path / "a.sog").gaussians
    bounds = ((high - low) / 65535 / 2 + 1e-6) * (1 + np.abs(means)) * 1.001
    assert (np.abs(gaussians.means - means) <= bounds).all()
    assert rotation_angles(gaussians.quats, quats).max() < 1.1


def test_playbot_opens_at_its_finest_level(splat_files):
    counts = {2: 125_000, 3: 31_000, 4: 8_406, 5: 3_000, 6: 1_873}
    finest = open_scene(splat_files / "playbot").gaussians
    assert len(finest) == counts[2]
    np.testing.assert_allclose(np.linalg.norm(finest.quats, axis=1), 1, atol=1e-5)
    assert np.isfinite(finest.sh_rest).all()
    assert finest.sh_degree == 2
    for level, count in counts.items():
        coarse = open_scene(splat_files / "playbot" / f"{level}_0" / "meta.json").gaussians
        assert len(coarse) == count
        # All levels show one robot: they end at the same places, though they spend their splats differently.
        for end in (np.min, np.max):
            np.testing.assert_allclose(end(coarse.means, axis=0), end(finest.means, axis=0), atol=0.02)
    assert len(read_sog_folder(splat_files / "playbot", level=4)) == counts[4]
    assert len(read_sog_folder(splat_files / "playbot", level=0)) == counts[2]
    assert len(read_sog_folder(splat_files / "playbot", level=99)) == counts[6]


def test_what_was_opened_can_be_saved_but_not_as_a_checkpoint(tmp_path):
    content, meta = small_scene()
    write_archive(tmp_path / "a.sog", files_of(content, meta))
    before = (tmp_path / "a.sog").read_bytes()
    scene = open_scene(tmp_path / "a.sog")
    save_scene(tmp_path / "a.ply", scene)
    assert open_scene(tmp_path / "a.ply").gaussians.means.tobytes() == scene.gaussians.means.tobytes()
    with pytest.raises(DataError, match=r"can be opened but not written.*\.spz"):
        save_scene(tmp_path / "a.ckpt", random_scene())
    with pytest.raises(DataError, match="actors that move"):
        save_scene(tmp_path / "a.sog", random_scene())
    assert (tmp_path / "a.sog").read_bytes() == before


def write_levels(folder, tree, chunks, **more):
    """A streamed scene of chunks {name: (count, bands)}; returns each chunk's x coordinates."""
    positions = {}
    for seed, (name, (count, bands)) in enumerate(chunks.items()):
        content, meta = small_scene(count, bands, seed)
        write_folder(folder / name, files_of(content, meta))
        positions[name] = [expected_position(content, meta, row, 0) for row in range(count)]
    filenames = [f"{name}/meta.json" for name in chunks]
    description = {"version": 1, "lodLevels": 2, "filenames": filenames, "tree": tree} | more
    (folder / "lod-meta.json").write_text(json.dumps(description))
    return positions


def leaf(**levels):
    entries = {
        name.removeprefix("l"): dict(zip(("file", "offset", "count"), entry, strict=True))
        for name, entry in levels.items()
    }
    return {"bound": {"min": [0, 0, 0], "max": [1, 1, 1]}, "lods": entries}


def test_a_streamed_scene_shows_the_finest_rows_of_each_leaf(tmp_path):
    tree = {"children": [leaf(l0=(0, 3, 4), l1=(1, 0, 2)), {"children": [leaf(l1=(1, 2, 3)), leaf(l0=(0, 0, 3))]}]}
    chunks = {"0_0": (9, 2), "1_0": (6, 0), "env": (5, 1)}
    x = write_levels(tmp_path, tree, chunks, environment="env/meta.json")
    for path in (tmp_path, tmp_path / "lod-meta.json"):
        gaussians = open_scene(path).gaussians
        wanted = x["0_0"][0:7] + x["1_0"][2:5] + x["env"]
        np.testing.assert_allclose(gaussians.means[:, 0], wanted, rtol=1e-5, atol=1e-6)
    assert gaussians.sh_degree == 2
    assert not gaussians.sh_rest[7:10].any()
    coarse = read_sog_folder(tmp_path, level=1).gaussians
    np.testing.assert_allclose(coarse.means[:, 0], x["0_0"][0:3] + x["1_0"][0:5] + x["env"], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("tree", "more", "message"),
    [
        (leaf(l0=(0, 0, 10)), {}, "rows 0 to 10 of file 0 overlap others or its end"),
        ({"children": [leaf(l0=(0, 0, 4)), leaf(l0=(0, 3, 2))]}, {}, "rows 3 to 5 of file 0 overlap"),
        (leaf(l0=(1, 0, 1)), {}, "uses file 1 of 1"),
        (leaf(l0=(0, -1, 1)), {}, "not whole numbers"),
        (leaf(l0=(0, 0.5, 1)), {}, "not whole numbers"),
        (leaf(l0=(0, 0, 0)), {}, "names no splats"),
        ([], {}, "not a node"),
        ({"children": 5}, {}, "wrong kind"),
        (leaf(l0=(0, 0, 1)), {"version": 2}, "'version' 2, not 1"),
        (leaf(l0=(0, 0, 1)), {"filenames": "0_0/meta.json"}, "not a list"),
        (leaf(l0=(0, 0, 1)), {"filenames": ["1_0/meta.json"]}, "is missing"),
        (leaf(l0=(0, 0, 1)), {"environment": "0_0/meta.json"}, "same file"),
        (leaf(l0=(0, 0, 1)), {"filenames": ["../0_0/meta.json"]}, "leads out of the scene's folder"),
        (leaf(l0=(0, 0, 1)), {"filenames": ["/etc/passwd"]}, "leads out of the scene's folder"),
        (leaf(l0=(0, 0, 1)), {"environment": "..\\meta.json"}, "leads out of the scene's folder"),
    ],
)
def test_wrong_level_files_are_explained(tmp_path, tree, more, message):
    write_levels(tmp_path, tree, {"0_0": (9, 0)}, **more)
    with pytest.raises(DataError, match=message):
        open_scene(tmp_path)


def test_a_deep_tree_is_no_trouble(tmp_path):
    tree = leaf(l0=(0, 0, 1))
    text = '{"children": [' * 400 + json.dumps(tree) + "]}" * 400
    write_levels(tmp_path, json.loads(text), {"0_0": (9, 0)})
    assert len(open_scene(tmp_path)) == 1
    described = (tmp_path / "lod-meta.json").read_text().replace(text, "[" * 100_000)
    (tmp_path / "lod-meta.json").write_text(described)
    with pytest.raises(DataError, match="is no JSON"):
        open_scene(tmp_path)


def changed_meta(path, value):
    """A scene whose meta.json has one value changed, e.g. at "means.mins"."""
    content, meta = small_scene()
    entry = meta
    *above, last = path.split(".")
    for name in above:
        entry = entry[name]
    if value is None:
        del entry[last]
    else:
        entry[last] = value
    return files_of(content, meta)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("version", 3, "'version' 3"),
        ("count", None, "'count' None"),
        ("count", -1, "'count' -1"),
        ("count", 3.5, "'count' 3.5"),
        ("count", 1000, "pixels, expected 1000"),
        ("count", SMALL_COUNT * 10, f"{SMALL_COUNT * 10} splats in"),
        ("means", None, "no 'means' object"),
        ("means.mins", [0, 0], "'means.mins' a list of 2, not a list of 3"),
        ("means.maxs", [0, float("nan"), 0], "nan in 'means.maxs'"),
        ("means.maxs", [0, 1e9, 0], "beyond ±80"),
        ("means.files", ["means_l.webp"], "not 2 files"),
        ("means.files", ["means_l.webp", "absent.webp"], "holds no 'absent.webp'"),
        ("quats.files", ["../quats.webp"], "leads out of the scene's folder"),
        ("quats.files", ["/etc/passwd"], "leads out of the scene's folder"),
        ("quats.files", ["C:\\quats.webp"], "leads out of the scene's folder"),
        ("quats.files", [5], "5 stands where a file's name should"),
        ("quats.files", ["meta.json"], "image 'meta.json' cannot be used"),
        ("scales.codebook", [1.0] * 255, "'scales.codebook' a list of 255"),
        ("sh0.codebook", ["1"] * 256, "'1' in 'sh0.codebook'"),
        ("shN.bands", 4, "'shN.bands' is 4"),
        ("shN.bands", 3, "fit no 70 entries"),
        ("shN.count", 1 << 17, "'shN.count' is 131072"),
        ("shN.count", 200, "fit no 200 entries"),
        ("shN.count", 20, "names SH entry"),
        ("shN", [], "no 'shN' object"),
    ],
)
def test_wrong_descriptions_are_explained(tmp_path, path, value, message):
    files = changed_meta(path, value)
    write_archive(tmp_path / "a.sog", files)
    with pytest.raises(DataError, match=message) as caught:
        open_scene(tmp_path / "a.sog")
    assert isinstance(caught.value, UntrustedDataError) == ("leads out" in message)


def test_names_that_lead_out_of_a_folder_are_refused_though_the_file_is_there(tmp_path):
    files = changed_meta("quats.files", ["../quats.webp"])
    write_folder(tmp_path / "scene", files)
    (tmp_path / "quats.webp").write_bytes(files["quats.webp"])
    with pytest.raises(UntrustedDataError, match="leads out of the scene's folder"):
        open_scene(tmp_path / "scene")


def test_wrong_rotation_tags_are_explained(tmp_path):
    content, meta = small_scene()
    content["quats"][20, 3] = 17
    write_archive(tmp_path / "a.sog", files_of(content, meta))
    with pytest.raises(DataError, match="rotation of splat 20 has tag 17"):
        open_scene(tmp_path / "a.sog")


def claimed_size(data, side):
    """A lossless WebP whose header promises side × side pixels."""
    place = data.index(b"VP8L") + 9
    bits = (side - 1) | (side - 1) << 14 | int.from_bytes(data[place : place + 4], "little") >> 28 << 28
    return data[:place] + bits.to_bytes(4, "little") + data[place + 4 :]


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("quats.webp", lambda data: data[: len(data) // 2], "cannot be used"),
        ("quats.webp", lambda data: b"", "cannot be used"),
        ("quats.webp", lambda data: claimed_size(data, 16384), "16384 × 16384 pixels"),
        ("sh0.webp", lambda data: webp(np.zeros((1000, 1000, 4), np.uint8)), "1000 × 1000 pixels"),
        ("sh0.webp", lambda data: webp(np.zeros((8, 8, 3), np.uint8), lossless=False), "with losses"),
        ("sh0.webp", lambda data: data + bytes(1 << 21), "holds more than"),
        ("means_u.webp", lambda data: splat_image(np.zeros((4, 3), np.uint8)), "pixels, expected 37"),
        ("shN_centroids.webp", lambda data: webp(np.zeros((2, 100, 4), np.uint8)), "fit no 70 entries"),
        ("meta.json", lambda data: data[:-5], "is no JSON"),
        ("meta.json", lambda data: b"[1]", "holds a list, not an object"),
        ("meta.json", lambda data: b"\xff\xfe", "is no JSON"),
    ],
)
def test_wrong_files_inside_are_explained(tmp_path, name, make, message):
    files = files_of(*small_scene())
    files[name] = make(files[name])
    write_archive(tmp_path / "a.sog", files)
    with pytest.raises(DataError, match=message):
        open_scene(tmp_path / "a.sog")
    write_folder(tmp_path / "folder", files)
    with pytest.raises(DataError, match=message):
        open_scene(tmp_path / "folder")


def test_archive_bombs_and_odd_archives_are_explained(tmp_path):
    files = files_of(*small_scene())
    write_archive(tmp_path / "bomb.sog", files | {"meta.json": b" " * (40 << 20)}, zipfile.ZIP_DEFLATED)
    with pytest.raises(DataError, match=r"'meta\.json' holds more than 16777216 bytes"):
        open_scene(tmp_path / "bomb.sog")
    write_archive(tmp_path / "method.sog", files, zipfile.ZIP_LZMA)
    with pytest.raises(DataError, match="method 14"):
        open_scene(tmp_path / "method.sog")
    (tmp_path / "none.sog").write_bytes(b"PK\3\4 nothing")
    with pytest.raises(DataError, match="no whole zip archive"):
        open_scene(tmp_path / "none.sog")
    # A member whose promised size is a lie.
    content = bytearray((tmp_path / "bomb.sog").read_bytes())
    for place in (content.find(struct.pack("<I", 40 << 20)), content.rfind(struct.pack("<I", 40 << 20))):
        content[place : place + 4] = struct.pack("<I", 10)
    (tmp_path / "lie.sog").write_bytes(content)
    with pytest.raises(DataError, match=r"meta\.json"):
        open_scene(tmp_path / "lie.sog")


def test_a_folder_without_images_is_explained(tmp_path):
    files = files_of(*small_scene())
    del files["sh0.webp"]
    write_folder(tmp_path, files)
    with pytest.raises(DataError, match=r"'sh0\.webp' is missing"):
        open_scene(tmp_path / "meta.json")


@settings(max_examples=120, deadline=None, suppress_health_check=SHARES_A_FOLDER)
@given(st.data())
def test_damaged_archives_open_or_explain_themselves(tmp_path, data):
    files = files_of(*small_scene(bands=1))
    if data.draw(st.booleans()):
        name = data.draw(st.sampled_from(sorted(files)))
        damaged = bytearray(files[name])
        for _ in range(data.draw(st.integers(1, 4))):
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
        files[name] = bytes(damaged)
        write_archive(tmp_path / "a.sog", files)
    else:
        write_archive(tmp_path / "good.sog", files)
        content = bytearray((tmp_path / "good.sog").read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        (tmp_path / "a.sog").write_bytes(content[: data.draw(st.integers(len(content) // 2, len(content)))])
    with contextlib.suppress(DataError):
        assert len(open_scene(tmp_path / "a.sog")) <= 64
