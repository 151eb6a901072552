"""Masks of another clip are told: by their shape, and by borders that lie on no edge."""

import numpy as np
import pytest
from post_street import PostStreet

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.masks.label_map_folder import FrameMasks, MaskFolder, write_masks
from instdrive_core.masks.photo_fit import describe_misfit


@pytest.fixture(scope="module")
def clip() -> Clip:
    return PostStreet().build_clip()


def write(folder, street: PostStreet, size=None) -> MaskFolder:
    """Masks of a street's own photos, maybe of another size."""
    frames = {frame.key: street.labels(frame.view.camera) for frame in street.build_clip().frames}
    masks = {key: FrameMasks(labels, np.zeros(labels.shape, bool)) for key, labels in frames.items()}
    if size is not None:
        masks = {key: one.resize(*size) for key, one in masks.items()}
    return write_masks(folder, masks.items(), "import", 0)


def test_own_masks_fit_at_any_scale(clip, tmp_path):
    assert describe_misfit(clip, write(tmp_path / "own", PostStreet())) is None
    assert describe_misfit(clip, write(tmp_path / "large", PostStreet(), (480, 120))) is None


def test_masks_of_another_clip_are_told(clip, tmp_path):
    misfit = describe_misfit(clip, write(tmp_path / "other", PostStreet(seed=4)))
    assert misfit is not None
    assert str(tmp_path / "other" / "masks.json") in misfit
    assert "instdrive masks posts" in misfit


def test_masks_of_another_shape_are_refused(clip, tmp_path):
    with pytest.raises(DataError, match=r"masks of 'left/00' are 240×90, its photo 240×60"):
        describe_misfit(clip, write(tmp_path / "tall", PostStreet(), (240, 90)))
