"""Contact sheets: one per camera, each mask in its colour over the photo."""

from dataclasses import replace

import numpy as np
import pytest
from painted_street import HEIGHT, SKY, WIDTH, painted_clip, photo, truth
from PIL import Image

from instdrive_core.errors import DataError, OptionError
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.masks.contact_sheet import (
    GAP,
    build_contact_sheet,
    check_sheet_path,
    paint_masks,
    write_contact_sheets,
)
from instdrive_core.masks.label_map_folder import FrameMasks, write_masks

LABELS = truth(0.2).astype(np.uint16)
"""Labels of the clip's first photo."""


@pytest.fixture
def clip(tmp_path):
    """Twelve steps, eleven of which train, seen by two cameras."""
    clip = painted_clip(str(tmp_path), range(2, 14))
    other = tuple(replace(frame, view=replace(frame.view, name="back_camera")) for frame in clip.frames)
    return replace(clip, frames=clip.frames + other)


@pytest.fixture
def masks(clip, tmp_path):
    found = [(frame.key, truth(frame.view.time)) for frame in clip.training_frames]
    labelled = [(key, FrameMasks(labels.astype(np.uint16), labels == SKY)) for key, labels in found]
    return write_masks(tmp_path / "masks", labelled, "exact", 0)


def test_masks_have_the_colours_of_their_ids():
    image, masks = photo(0.2), FrameMasks(LABELS, LABELS == SKY)
    picture = paint_masks(image, masks).astype(float)
    assert picture.shape == image.shape
    outlines = (picture == 255).all(axis=2)
    for label in np.unique(LABELS[LABELS > 0]):
        inner = (label == LABELS) & ~outlines
        grey = image[inner].mean(axis=1, keepdims=True)
        expected = 0.6 * colors_from_ids(np.array([label], np.uint32)) + 0.4 * grey
        np.testing.assert_allclose(picture[inner], expected, atol=1)
    step = LABELS[:, :-1] != LABELS[:, 1:]
    assert outlines[:, :-1][step].all()
    assert outlines.mean() < 0.1


def test_the_sky_is_hatched_and_what_has_no_mask_is_dark():
    labels = np.where(LABELS == 13, 0, LABELS).astype(np.uint16)
    picture = paint_masks(np.full((HEIGHT, WIDTH, 3), 100, np.uint8), FrameMasks(labels, labels == SKY))
    sky = picture[labels == 0]
    assert set(np.unique(sky)) == {45, 220, 255}
    hidden = paint_masks(np.full((HEIGHT, WIDTH, 3), 100, np.uint8), FrameMasks(labels, np.zeros_like(labels, bool)))
    assert set(np.unique(hidden[labels == 0])) == {45, 255}


def test_a_sheet_shows_up_to_nine_photos_spread_over_the_clip(clip, masks):
    frames = [frame for frame in clip.training_frames if frame.view.name == "front_camera"]
    assert len(frames) == 11
    assert build_contact_sheet(frames, masks).size == (3 * (WIDTH + GAP) + GAP, 3 * (HEIGHT + GAP) + GAP)
    sheet = np.asarray(build_contact_sheet([frames[0], frames[-1]], masks))
    assert sheet.shape == (HEIGHT + 2 * GAP, 2 * WIDTH + 3 * GAP, 3)
    last = sheet[GAP:-GAP, 2 * GAP + WIDTH : -GAP][20:]
    painted = paint_masks(photo(frames[-1].view.time), masks.load(frames[-1]))
    np.testing.assert_array_equal(last, painted[20:], err_msg="below the caption")


def test_there_is_a_sheet_per_camera(clip, masks, tmp_path):
    files = write_contact_sheets(clip, masks, tmp_path / "new" / "sheet.png")
    assert [file.name for file in files] == ["sheet_front_camera.png", "sheet_back_camera.png"]
    files = write_contact_sheets(clip, masks, tmp_path / "folder")
    assert [file.relative_to(tmp_path / "folder").as_posix() for file in files] == [
        "front_camera.jpg",
        "back_camera.jpg",
    ]
    alone = replace(clip, frames=tuple(frame for frame in clip.frames if frame.view.name == "back_camera"))
    assert write_contact_sheets(alone, masks, tmp_path / "one.jpg") == (tmp_path / "one.jpg",)
    with Image.open(tmp_path / "one.jpg") as picture:
        assert picture.format == "JPEG"


def test_places_that_cannot_be_written_are_named(clip, masks, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match=r"cannot be written .* --sheet"):
        write_contact_sheets(clip, masks, tmp_path / "file" / "sheets")
    with pytest.raises(OptionError, match=r"sheet\.gif: a picture is \.jpg or \.png"):
        check_sheet_path(tmp_path / "sheet.gif")
