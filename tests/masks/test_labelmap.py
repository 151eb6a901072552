"""Mask folders: what is written is read back; what is damaged is named."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from painted_street import painted_clip
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.masks.label_map_folder import (
    FrameMasks,
    locate_label_map,
    locate_sky_mask,
    open_masks,
    resample_nearest,
    shuffle_labels,
    write_masks,
)

KEY = "front_camera/30"


def some_masks(height=6, width=8):
    labels = np.arange(height * width, dtype=np.uint16).reshape(height, width)
    labels[0, 0], labels[-1, -1] = 0, 65535
    return FrameMasks(labels, labels % 3 == 0)


@pytest.fixture
def folder(tmp_path):
    write_masks(tmp_path / "masks", [(KEY, some_masks())], "exact", 7)
    return tmp_path / "masks"


def test_masks_are_read_back_bit_by_bit(folder):
    found = open_masks(folder)
    masks = found.load(KEY)
    np.testing.assert_array_equal(masks.labels, some_masks().labels)
    np.testing.assert_array_equal(masks.sky, some_masks().sky)
    assert masks.labels.dtype == np.uint16
    assert (found.source, found.seed, found.counts) == ("exact", 7, {KEY: 47})
    assert json.loads((folder / "masks.json").read_text())["frames"][KEY] == {"width": 8, "height": 6, "masks": 47}


def test_a_frame_gets_masks_of_its_own_size(tmp_path):
    frame = painted_clip("").frames[0]
    write_masks(tmp_path, [(frame.key, some_masks(45, 80))], "exact", 0)
    masks = open_masks(tmp_path).load(frame)
    assert masks.labels.shape == masks.sky.shape == (90, 160)
    np.testing.assert_array_equal(masks.labels[::2, ::2], some_masks(45, 80).labels)


def test_nearest_takes_the_pixel_under_each_centre():
    raster = np.arange(12).reshape(3, 4)
    np.testing.assert_array_equal(resample_nearest(raster, 8, 6), raster.repeat(2, 0).repeat(2, 1))
    np.testing.assert_array_equal(resample_nearest(raster, 2, 3), raster[:, 1::2])


@given(arrays.arrays(np.uint32, (5, 6), elements=st.integers(0, 9)), st.integers(0, 5))
@settings(max_examples=40, deadline=None)
def test_shuffling_keeps_what_belongs_together(instances, seed):
    labels = shuffle_labels(instances, KEY, seed)
    pairs = set(zip(instances.ravel().tolist(), labels.ravel().tolist(), strict=True))
    assert len({a for a, _ in pairs}) == len(pairs) == len({b for _, b in pairs})
    assert all((a == 0) == (b == 0) for a, b in pairs)
    assert set(labels[labels > 0].tolist()) == set(range(1, len({a for a, _ in pairs} - {0}) + 1))


def test_labels_tell_nothing_across_frames_and_repeat_by_seed():
    instances = np.arange(101)[None].repeat(2, axis=0)
    first, second = shuffle_labels(instances, "front_camera/30", 0), shuffle_labels(instances, "front_camera/31", 0)
    np.testing.assert_array_equal(first, shuffle_labels(instances, "front_camera/30", 0))
    assert (first == second).mean() < 0.1
    assert (first == shuffle_labels(instances, "front_camera/30", 1)).mean() < 0.1


def test_more_instances_than_16_bits_are_refused():
    with pytest.raises(ValueError, match="70000 instances"):
        shuffle_labels(np.arange(70001)[None], KEY, 0)


def test_an_unfinished_folder_is_refused(folder):
    (folder / "masks.json").unlink()
    with pytest.raises(DataError, match=r"'masks\.json' is missing"):
        open_masks(folder)


def test_a_folder_that_failed_half_way_has_no_sidecar(folder):
    def failing():
        yield KEY, some_masks()
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write_masks(folder, failing(), "exact", 0)
    with pytest.raises(DataError, match="no finished folder"):
        open_masks(folder)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match=r"cannot be written .* --out"):
        write_masks(tmp_path / "file" / "masks", [(KEY, some_masks())], "exact", 0)


@pytest.mark.parametrize(
    ("sidecar", "message"),
    [
        ("{", "no readable JSON"),
        ("{}", "'version' is missing"),
        ('{"version": 2}', "has version 2, this program reads 1"),
        ('{"version": 1, "frames": []}', "'frames' is no object"),
        ('{"version": 1, "frames": {"a/1": {}}}', r"'frames\.a/1\.masks' is missing"),
        ('{"version": 1, "frames": {"../../x": {"masks": 1}}}', "no 'camera/number'"),
        ('{"version": 1, "frames": {"../x": {"masks": 1}}}', "no 'camera/number'"),
        ('{"version": 1, "frames": {}, "seed": "a"}', "'seed' is 'a'"),
    ],
)
def test_damaged_sidecars_are_named(folder, sidecar, message):
    (folder / "masks.json").write_text(sidecar)
    with pytest.raises(DataError, match=message):
        open_masks(folder)


def test_damaged_files_are_named_when_read(folder):
    masks = open_masks(folder)
    with pytest.raises(DataError, match="the frame 'front_camera/31' has no masks"):
        masks.load("front_camera/31")
    Image.fromarray(np.zeros((5, 8), np.uint8)).save(locate_sky_mask(folder, KEY))
    with pytest.raises(DataError, match=r"30_sky\.png: is 8×5, the label map 8×6"):
        masks.load(KEY)
    locate_label_map(folder, KEY).write_bytes(b"no picture")
    with pytest.raises(DataError, match=r"30\.png: is no readable PNG"):
        masks.load(KEY)
    Image.fromarray(np.zeros((6, 8, 3), np.uint8)).save(locate_label_map(folder, KEY))
    with pytest.raises(DataError, match="has the image mode RGB"):
        masks.load(KEY)
    locate_label_map(folder, KEY).unlink()
    with pytest.raises(DataError, match=r"30\.png: is missing"):
        masks.load(KEY)


def test_faults_are_told_and_older_sidecars_open(folder, tmp_path):
    assert open_masks(folder).faults is None
    write_masks(tmp_path / "faulty", [(KEY, some_masks())], "exact", 7, "sam-v1")
    assert open_masks(tmp_path / "faulty").faults == "sam-v1"
    sidecar = json.loads((folder / "masks.json").read_text())
    del sidecar["faults"]
    (folder / "masks.json").write_text(json.dumps(sidecar))
    assert open_masks(folder).faults is None
    (folder / "masks.json").write_text(json.dumps(sidecar | {"faults": 3}))
    with pytest.raises(DataError, match="'faults' is 3"):
        open_masks(folder)
