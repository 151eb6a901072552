"""Photos and masks beside the splats."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from instdrive_app.session.reference_pictures import ReferencePictures, color_masks, find_masks, load_reference_picture
from instdrive_app.state import Reference
from instdrive_core.errors import DataError
from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.masks.label_map_folder import FrameMasks, write_masks


@pytest.fixture
def view(street, tmp_path):
    """A dataset view with a photo and masks on the disk."""
    rng = np.random.default_rng(3)
    photo = tmp_path / "clip" / "camera" / "front" / "00.png"
    photo.parent.mkdir(parents=True)
    Image.fromarray(rng.integers(0, 255, (54, 96, 3), np.uint8)).save(photo)
    labels = np.zeros((27, 48), np.uint16)
    labels[5:20, 10:30] = 7
    sky = np.zeros(labels.shape, bool)
    sky[:4] = True
    write_masks(tmp_path / "clip" / "masks", [("front/00", FrameMasks(labels, sky))], "exact", 0)
    return replace(street.scene.views[0], name="front", index=0, photo=str(photo))


def test_photo_and_masks_are_read(view):
    photo = load_reference_picture(view, Reference.PHOTO)
    np.testing.assert_array_equal(photo[..., :3], np.asarray(Image.open(view.photo)))
    assert (photo[..., 3] == 255).all()
    masks = load_reference_picture(view, Reference.MASKS)
    assert masks.shape == (27, 48, 4)
    assert masks[12, 20, 3] == 255
    assert ids_from_colors(masks[12:13, 20, :3])[0] > 0
    assert masks[25, 5, 3] == 0, "nothing is known there"
    assert masks[1, 5, 2] > masks[1, 5, 0], "the sky is blue"


def test_what_is_missing_is_named(view, tmp_path):
    with pytest.raises(DataError, match="does not record where"):
        load_reference_picture(replace(view, photo=""), Reference.PHOTO)
    with pytest.raises(DataError, match="no longer there"):
        load_reference_picture(replace(view, photo=str(tmp_path / "gone.png")), Reference.PHOTO)
    photo = tmp_path / "elsewhere" / "00.png"
    with pytest.raises(DataError, match="no longer there"):
        find_masks(photo)
    photo.parent.mkdir()
    photo.touch()
    with pytest.raises(DataError, match="no folder masks/"):
        find_masks(photo)


def test_pictures_are_read_beside_the_window_and_failures_told_once(view, tmp_path):
    told, ready = [], threading.Event()
    pictures = ReferencePictures(told.append, ready.set)
    assert pictures.get(view, Reference.PHOTO) is None or ready.is_set()
    assert ready.wait(120)
    first = pictures.get(view, Reference.PHOTO)
    assert first is not None
    assert pictures.get(view, Reference.PHOTO) is first, "kept, so that it is uploaded once"
    ready.clear()
    broken = replace(view, photo=str(tmp_path / "gone.png"))
    pictures.get(broken, Reference.PHOTO)
    assert ready.wait(120)
    for _ in range(3):
        assert pictures.get(broken, Reference.PHOTO) is None
    assert len(told) == 1
    assert "gone.png" in told[0]
    pictures.close()


def test_photos_that_were_held_out_have_no_masks_and_nobody_is_told_off(view):
    told, ready = [], threading.Event()
    pictures = ReferencePictures(told.append, ready.set)
    pictures.get(view, Reference.MASKS)
    assert ready.wait(120)
    masks = pictures.get(view, Reference.MASKS)
    assert pictures.explain_missing(view, Reference.MASKS) == ""
    ready.clear()
    held_out = replace(view, index=1, held_out=True)
    pictures.get(held_out, Reference.MASKS)
    assert ready.wait(120)
    assert pictures.get(held_out, Reference.MASKS) is None
    assert "Held out" in pictures.explain_missing(held_out, Reference.MASKS)
    assert told == []
    assert pictures.get(view, Reference.MASKS) is masks
    ready.clear()
    unknown = replace(view, index=2)
    assert pictures.get(unknown, Reference.MASKS) is masks or ready.is_set(), "the last one, until it is known"
    assert ready.wait(120)
    assert pictures.get(unknown, Reference.MASKS) is None
    assert len(told) == 1
    pictures.close()


def test_borders_between_masks_are_dark():
    labels = np.repeat(np.array([[1, 1, 2, 2]], np.uint16), 3, axis=0)
    picture = color_masks(FrameMasks(labels, np.zeros(labels.shape, bool)))
    assert picture[1, 2, :3].sum() < picture[1, 3, :3].sum()
