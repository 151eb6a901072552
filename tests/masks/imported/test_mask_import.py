"""Masks made elsewhere: what fits is read as written, what does not is named with file, field and value."""

import contextlib
import io
import json
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.lib import format as npy
from painted_street import CAR, ROAD, SKY, WALL, painted_clip, truth
from PIL import Image
from pycocotools import mask as coco

from instdrive_core.errors import DataError, OptionError
from instdrive_core.masks.image.painting import Painting
from instdrive_core.masks.imported.checks import check_size
from instdrive_core.masks.imported.label_map import read_imported_label_map
from instdrive_core.masks.imported.labels import ImportedLabels
from instdrive_core.masks.imported.npz import read_imported_npz
from instdrive_core.masks.imported.rle import read_imported_rle
from instdrive_core.masks.making import make_masks
from instdrive_core.masks.sources import SourceOptions

HEIGHT, WIDTH = 18, 32
NESTED = np.zeros((3, HEIGHT, WIDTH), bool)
NESTED[0, 2:8, 2:8] = True
NESTED[1] = True
NESTED[2, 4:6, 4:20] = True
TOP = np.where(NESTED[2], 3, np.where(NESTED[0], 1, 2))
"""What is seen where small masks lie over large ones."""


def encoded(mask):
    run_lengths = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    return {"size": list(mask.shape), "counts": run_lengths["counts"].decode()}


def plain_runs(mask):
    flat = mask.ravel(order="F").astype(int)
    edges = np.flatnonzero(np.diff(flat, prepend=0)).tolist()
    return {"size": list(mask.shape), "counts": np.diff([0, *edges, flat.size]).tolist()}


def write_rle(file, segmentations, key=None):
    entries = [{"segmentation": segmentation, "area": 1, "bbox": [0, 0, 1, 1]} for segmentation in segmentations]
    file.write_text(json.dumps(entries if key is None else {key: entries}))
    return file


def write_npz(file, save=np.savez_compressed, **arrays):
    save(file, **arrays)
    return file


def write_png(file, raster):
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(raster).save(file)
    return file


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("values", [NESTED, NESTED.astype(np.uint8) * 255, NESTED.astype(np.int64)])
@pytest.mark.parametrize("name", ["masks", "segmentations"])
def test_archives_are_read_small_over_large(tmp_path, save, values, name):
    file = write_npz(tmp_path / "00.npz", save, **{name: values, "scores": np.ones(3)})
    np.testing.assert_array_equal(read_imported_npz(file, WIDTH, HEIGHT), TOP)


@pytest.mark.parametrize("encode", [encoded, plain_runs])
@pytest.mark.parametrize("key", [None, "annotations"])
def test_run_lengths_are_read_small_over_large(tmp_path, encode, key):
    file = write_rle(tmp_path / "00.json", [encode(mask) for mask in NESTED], key)
    np.testing.assert_array_equal(read_imported_rle(file, WIDTH, HEIGHT), TOP)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_label_maps_are_read_as_they_are(tmp_path, dtype):
    file = write_png(tmp_path / "00.png", TOP.astype(dtype))
    np.testing.assert_array_equal(read_imported_label_map(file, WIDTH, HEIGHT), TOP)


def test_masks_of_larger_photos_are_brought_to_this_size(tmp_path):
    large = NESTED.repeat(4, axis=1).repeat(4, axis=2)
    files = [
        read_imported_npz(write_npz(tmp_path / "0.npz", masks=large), WIDTH, HEIGHT),
        read_imported_rle(write_rle(tmp_path / "0.json", [encoded(mask) for mask in large]), WIDTH, HEIGHT),
        read_imported_label_map(
            write_png(tmp_path / "0.png", TOP.repeat(4, 0).repeat(4, 1).astype(np.uint16)), WIDTH, HEIGHT
        ),
    ]
    for labels in files:
        np.testing.assert_array_equal(labels, TOP)


@given(arrays.arrays(bool, (4, 6, 7)))
@settings(max_examples=50, deadline=None)
def test_the_smallest_mask_is_on_top(masks):
    painting = Painting(6, 7)
    for mask in masks:
        painting.add(mask)
    areas = masks.sum(axis=(1, 2))
    for row in range(6):
        for column in range(7):
            there = np.flatnonzero(masks[:, row, column])
            expected = 1 + there[np.argmin(areas[there])] if len(there) else 0
            assert painting.labels[row, column] == expected


@given(arrays.arrays(bool, (5, 9)).filter(np.any))
@settings(max_examples=40, deadline=None)
def test_run_lengths_and_arrays_tell_the_same(tmp_path_factory, mask):
    folder = tmp_path_factory.mktemp("same")
    found = read_imported_rle(write_rle(folder / "0.json", [encoded(mask)]), 9, 5)
    np.testing.assert_array_equal(found, read_imported_npz(write_npz(folder / "0.npz", masks=mask[None]), 9, 5))
    np.testing.assert_array_equal(found, mask)


@pytest.mark.parametrize("size", [(480, 270), (1920, 1080), (341, 191)])
def test_masks_of_the_photos_shape_pass_at_any_size(tmp_path, size):
    """Passing means raising nothing; what is refused is tested below."""
    check_size(tmp_path, "it", size, (480, 270))


@pytest.mark.parametrize("size", [(270, 480), (480, 272), (240, 270), (1080, 1920), (640, 480)])
def test_masks_of_another_shape_are_refused(tmp_path, size):
    with pytest.raises(DataError, match=f"it is {size[0]}×{size[1]}, of another shape than the photo with 480×270"):
        check_size(tmp_path, "it", size, (480, 270))


@pytest.mark.parametrize(
    ("arrays_in_file", "message"),
    [
        ({"masks": NESTED[0]}, r"'masks' has the shape \(18, 32\), expected \(masks, height, width\)"),
        ({"masks": NESTED.astype(np.float32)}, "'masks' has the type float32, expected booleans"),
        ({"masks": NESTED * np.array([1, 2, 3])[:, None, None] + NESTED}, None),
        ({"masks": np.zeros((0, HEIGHT, WIDTH), bool)}, "'masks' holds no mask"),
        ({"masks": NESTED & False}, "the mask 0 of 'masks' is empty"),
        ({"masks": NESTED[:, :, :20]}, "'masks' is 20×18, of another shape than the photo with 32×18"),
        ({"masks": np.asfortranarray(NESTED)}, "'masks' is stored column by column"),
        ({"segmentations": TOP[None]}, "'segmentations' holds more than 0 and 3 in the mask 0"),
        ({"segmentations": -NESTED.astype(np.int8)}, "'segmentations' holds more than 0 and 0 in the mask 0"),
        ({"scores": np.ones(3), "boxes": np.ones(3)}, "has no array 'masks' or 'segmentations', but boxes, scores"),
        ({"masks": np.array([None, 1], object)}, "'masks' holds Python objects, which are never loaded"),
    ],
)
def test_archives_that_do_not_fit_are_named(tmp_path, arrays_in_file, message):
    file = write_npz(tmp_path / "07.npz", **arrays_in_file)
    if message is None:
        assert read_imported_npz(file, WIDTH, HEIGHT).max() == 3, "each mask may have a number of its own"
        return
    with pytest.raises(DataError, match=rf"07\.npz: .*{message}"):
        read_imported_npz(file, WIDTH, HEIGHT)


def forged_archive(file, shape, content=b"", dtype="|b1"):
    """An archive whose array claims a shape that it does not have."""
    header = io.BytesIO()
    npy.write_array_header_1_0(header, {"descr": dtype, "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("masks.npy", header.getvalue() + content)
    return file


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((1, 1 << 30, 1 << 30), "larger than the 67108864 pixels"),
        ((60000, 1800, 3200), "takes more than 16 GiB"),
        ((1 << 40, 18, 32), "holds 1099511627776 masks"),
        ((-1, 18, 32), "holds no mask"),
        ((1, -18, -32), "there is nothing in it"),
        ((9, 18, 32), "ends within the mask 0 of 9"),
    ],
)
def test_archives_that_claim_too_much_are_refused_before_anything_is_allocated(tmp_path, shape, message):
    with pytest.raises(DataError, match=message):
        read_imported_npz(forged_archive(tmp_path / "00.npz", shape), WIDTH, HEIGHT)


def test_truth_values_that_are_none_are_read_as_true(tmp_path):
    file = forged_archive(tmp_path / "00.npz", (1, HEIGHT, WIDTH), b"\x07" * (HEIGHT * WIDTH))
    assert (read_imported_npz(file, WIDTH, HEIGHT) == 1).all()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", b"\x93NUMPY"])
def test_files_that_are_no_archives_are_named(tmp_path, content):
    (tmp_path / "00.npz").write_bytes(content)
    with pytest.raises(DataError, match=r"00\.npz: is no readable \.npz archive"):
        read_imported_npz(tmp_path / "00.npz", WIDTH, HEIGHT)
    with zipfile.ZipFile(tmp_path / "01.npz", "w") as archive:
        archive.writestr("masks.npy", content)
    with pytest.raises(DataError, match=r"01\.npz: is no readable \.npz archive"):
        read_imported_npz(tmp_path / "01.npz", WIDTH, HEIGHT)


GOOD = {"size": [HEIGHT, WIDTH], "counts": encoded(NESTED[0])["counts"]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "no readable JSON"),
        ([], "the list holds no mask"),
        (3, "holds int, expected a list of masks"),
        ({"masks": []}, "'annotations' is missing"),
        ({"annotations": []}, "the field 'annotations' holds no mask"),
        ([{"area": 3}], r"'\[0\]\.segmentation' is missing"),
        (
            [{"segmentation": GOOD}, {"segmentation": [[0, 0, 5, 5, 0, 5]]}],
            r"'\[1\]\.segmentation' is no object.*Polygon",
        ),
        ({"annotations": [{"segmentation": {"counts": ""}}]}, r"'annotations\[0\]\.segmentation\.size' is missing"),
        ([{"segmentation": GOOD | {"size": [18]}}], r"size' is \[18\], expected \[height, width\]"),
        ([{"segmentation": GOOD | {"size": [18.0, 32]}}], r"size' is \[18\.0, 32\]"),
        ([{"segmentation": GOOD | {"size": [WIDTH, HEIGHT]}}], "size' is 18×32, of another shape"),
        ([{"segmentation": GOOD | {"size": [18 << 20, 32 << 20]}}], "larger than the 67108864 pixels"),
        ([{"segmentation": GOOD | {"size": [-18, -32]}}], "there is nothing in it"),
        ([{"segmentation": GOOD | {"counts": "o"}}], "is 'o', which is no text of run lengths"),
        ([{"segmentation": GOOD | {"counts": "ä0"}}], "is 'ä0', which is no text of run lengths"),
        ([{"segmentation": GOOD | {"counts": "ooooooooooooo0"}}], "which is no text of run lengths"),
        ([{"segmentation": GOOD | {"counts": "ooo0"}}], "cannot be decoded"),
        ([{"segmentation": GOOD | {"counts": None}}], "neither a text nor a list"),
        ([{"segmentation": GOOD | {"counts": [-4, 580]}}], "neither a text nor a list"),
        ([{"segmentation": GOOD | {"counts": [5, 5]}}], "covers 10 pixels of 576"),
        ([{"segmentation": GOOD | {"counts": [576]}}], r"'\[0\]\.segmentation' is an empty mask"),
    ],
)
def test_run_lengths_that_do_not_fit_are_named(tmp_path, content, message):
    (tmp_path / "07.json").write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(DataError, match=rf"07\.json: .*{message}"):
        read_imported_rle(tmp_path / "07.json", WIDTH, HEIGHT)


@given(st.text(st.characters(min_codepoint=40, max_codepoint=120), max_size=40))
@settings(max_examples=150, deadline=None)
def test_no_text_of_run_lengths_does_any_harm(tmp_path_factory, counts):
    file = write_rle(tmp_path_factory.mktemp("runs") / "0.json", [GOOD | {"counts": counts}])
    with contextlib.suppress(DataError):
        assert read_imported_rle(file, WIDTH, HEIGHT).shape == (HEIGHT, WIDTH)


@pytest.mark.parametrize(
    ("raster", "message"),
    [
        (np.full((HEIGHT, WIDTH), 70000, np.int32), "holds the label 65535|holds the label 70000"),
        (np.zeros((HEIGHT, WIDTH), np.uint8), "the label map holds no mask"),
        (np.ones((WIDTH, HEIGHT), np.uint8), "the label map is 18×32, of another shape"),
        (np.ones((HEIGHT, WIDTH, 3), np.uint8), "has the image mode RGB"),
    ],
)
def test_label_maps_that_do_not_fit_are_named(tmp_path, raster, message):
    file = tmp_path / "07.png"
    if raster.max() > 65535:  # PNG holds no more than 16 bits, whatever the file is called
        Image.fromarray(raster).save(file, "TIFF")
    else:
        write_png(file, raster)
    with pytest.raises(DataError, match=rf"07\.png: .*({message})"):
        read_imported_label_map(file, WIDTH, HEIGHT)
    file.write_bytes(b"no picture")
    with pytest.raises(DataError, match=r"07\.png: is no readable PNG"):
        read_imported_label_map(file, WIDTH, HEIGHT)


@pytest.fixture
def street(tmp_path):
    """A clip, and a folder with one of the three formats for each photo: road, wall, car and, but once, the sky."""
    clip = painted_clip(str(tmp_path / "clip"))
    folder = tmp_path / "elsewhere"
    for number, frame in enumerate(clip.training_frames):
        labels = truth(frame.view.time)
        masks = [labels == part for part in (ROAD, WALL, CAR, SKY)]
        file = folder / f"{frame.key}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        if number == 0:
            write_png(file, (labels + (labels == SKY) * 99).astype(np.uint8))
        elif number == 1:
            write_npz(file.with_suffix(".npz"), masks=np.array(masks))
        else:
            write_rle(file.with_suffix(".json"), [encoded(mask) for mask in masks])
            write_png(file.with_name(f"{file.stem}_sky.png"), masks[3].astype(np.uint8) * 255)
    return clip, folder


def test_a_folder_is_imported_without_its_sky(street, tmp_path):
    clip, folder = street
    found = make_masks(clip, "import", tmp_path / "masks", options=SourceOptions(imported=folder))
    assert found.source == "import"
    assert set(found.counts.values()) == {3}
    for frame in clip.training_frames:
        masks, labels = found.load(frame), truth(frame.view.time)
        for part in (ROAD, WALL, CAR):
            assert len(np.unique(masks.labels[labels == part])) == 1
        np.testing.assert_array_equal(masks.labels == 0, labels == SKY)
        np.testing.assert_array_equal(masks.sky, labels == SKY)


def test_photos_without_masks_and_with_two_files_are_named(street):
    clip, folder = street
    first, second, _ = (frame.key for frame in clip.training_frames)
    write_png(folder / f"{second}.png", np.ones((90, 160), np.uint8))
    with pytest.raises(DataError, match=rf"the photo {second} has 2 files with masks: 03\.png, 03\.npz"):
        ImportedLabels(clip, folder)
    (folder / f"{second}.png").unlink()
    (folder / f"{first}.png").unlink()
    with pytest.raises(DataError, match=rf"1 of 3 training photos have no masks, the first is {first}\..*\.npz"):
        ImportedLabels(clip, folder)
    with pytest.raises(DataError, match="3 of 3 training photos have no masks"):
        ImportedLabels(clip, folder / "nowhere")


def test_a_sky_of_another_shape_is_named(street):
    clip, folder = street
    frame = clip.training_frames[2]
    write_png(folder / f"{frame.key}_sky.png", np.zeros((90, 90), np.uint8))
    with pytest.raises(DataError, match=r"05_sky\.png: the sky mask is 90×90, of another shape"):
        ImportedLabels(clip, folder).load(frame)


def test_the_folder_to_import_must_be_named(street, tmp_path):
    with pytest.raises(OptionError, match="--from"):
        make_masks(street[0], "import", tmp_path / "masks")
