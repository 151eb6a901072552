"""What a photo and the edited splats differ by."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from procedural_street import FIRST_CAR, procedural_street

from instdrive_app.session.showing.photo_difference import HEAT_RAMP, HOT, compare_with_photo, paint_heat
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_colored
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.errors import DataError
from instdrive_core.rasterize.pictures import draw_picture
from instdrive_core.scene.exposure import Exposures


@pytest.fixture
def filmed(tmp_path):
    """A document, and a view of it whose photo is the picture of its splats."""
    scene = procedural_street()
    view = scene.views[0]
    Image.fromarray(draw_picture(scene, view.camera, view.time, "color")).save(tmp_path / "photo.png")
    return Document(scene), replace(view, photo=str(tmp_path / "photo.png"))


def test_equal_pictures_differ_by_their_rounding_only_and_edits_show(filmed):
    document, view = filmed
    before = compare_with_photo(document, view)
    assert before.psnr > 45
    assert before.mean_error < 0.005
    document.apply(DeleteInstances((FIRST_CAR,)))
    after = compare_with_photo(document, view)
    assert after.psnr < before.psnr - 5
    changed = (after.heat != before.heat).any(axis=-1)
    assert 0 < changed.mean() < 0.5, "only where the car stood"


def test_recolours_show_in_what_is_compared_beside_the_window(filmed):
    document, view = filmed
    before = compare_with_photo(freeze_colored(document), view)
    document.apply(RecolorInstances((FIRST_CAR,), "solid", (1.0, 0.0, 1.0)))
    assert compare_with_photo(freeze_colored(document), view).psnr < before.psnr - 5


def test_exposure_is_the_photos(filmed, tmp_path):
    document, view = filmed
    dark = np.asarray(Image.open(view.photo)) // 2
    Image.fromarray(dark).save(tmp_path / "dark.png")
    view = replace(view, photo=str(tmp_path / "dark.png"))
    assert compare_with_photo(document, view).psnr < 20
    key, matrix = f"{view.name}/{view.index:02d}", 0.5 * np.eye(3, 4, dtype=np.float32)
    document.scene.exposures = Exposures((key,), np.array([view.time]), matrix[None])
    assert compare_with_photo(document, view).psnr > 40


def test_heat_goes_from_the_first_to_the_last_colour():
    heat = paint_heat(np.array([[0.0, HOT, 1.0]]))
    np.testing.assert_array_equal(heat[0, 0, :3], np.round(255 * np.array(HEAT_RAMP[0])))
    np.testing.assert_array_equal(heat[0, 1:, :3], np.round(255 * np.array([HEAT_RAMP[-1]] * 2)))
    assert (heat[..., 3] == 255).all()


@pytest.mark.parametrize(("photo", "told"), [("", "does not record"), ("gone.png", "no longer there")])
def test_a_photo_that_is_missing_is_told(filmed, tmp_path, photo, told):
    document, view = filmed
    with pytest.raises(DataError, match=told):
        compare_with_photo(document, replace(view, photo=str(tmp_path / photo) if photo else ""))
