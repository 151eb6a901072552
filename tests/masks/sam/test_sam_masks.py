"""Segment Anything end to end with tiny random models: photos become labels."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from painted_street import painted_clip
from tiny_sam import EDGE, permissive

from instdrive_core.masks.sam.labels import SamLabels
from instdrive_core.masks.sam.proposals import (
    Proposer,
    Thresholds,
    build_grid,
    compute_content_size,
    compute_stability,
    prepare_photo,
    resize_logits,
)
from instdrive_core.masks.sam.weights import PhotoFormat, load_model

pytestmark = pytest.mark.usefixtures("one_thread")


def test_a_model_saved_to_disk_labels_photos(model_folder):
    clip = painted_clip("nowhere")
    labels = SamLabels(clip, permissive(model_folder))
    frame = clip.frames[0]
    found, sky = labels.load(frame), labels.load_sky(frame)
    assert found.shape == sky.shape == (90, 160)
    assert found.dtype == np.uint32
    assert sky.dtype == bool
    assert len(np.unique(found[found > 0])) > 1, "a random model draws a few things, here and there"
    assert (found[sky] == 0).all()


def test_same_photo_same_bits_whatever_came_before(model_folder):
    clip = painted_clip("nowhere")
    forth, back = (SamLabels(clip, permissive(model_folder)) for _ in range(2))
    first = [(forth.load(frame), forth.load_sky(frame)) for frame in clip.frames[:2]]
    second = [(back.load(frame), back.load_sky(frame)) for frame in clip.frames[1::-1]]
    for (labels, sky), (others, other_sky) in zip(first, reversed(second), strict=True):
        np.testing.assert_array_equal(labels, others)
        np.testing.assert_array_equal(sky, other_sky)


def test_nothing_is_labelled_on_the_ego_vehicle(sam_folder):
    clip = painted_clip("nowhere")
    valid = np.ones((90, 160), bool)
    valid[60:] = False
    frame = replace(clip.frames[0], valid=valid)
    labels = SamLabels(clip, permissive(sam_folder))
    assert labels.load(frame).any()
    assert not labels.load(frame)[60:].any()
    assert not labels.load_sky(frame)[60:].any()


def test_photos_and_masks_are_brought_to_size_as_the_library_does(sam_folder):
    from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil

    image = painted_clip("nowhere").frames[0].load_image()
    processor, photo = SamImageProcessorPil.from_pretrained(sam_folder), load_model(sam_folder)[1]
    inputs = processor(images=image, return_tensors="pt")
    np.testing.assert_allclose(prepare_photo(image, photo), inputs["pixel_values"][0].numpy(), atol=1e-5)
    rows, columns = torch.meshgrid(torch.arange(32.0), torch.arange(32.0), indexing="ij")
    disc = 40 - (rows - 9) ** 2 - (columns - 14) ** 2
    expected = processor.post_process_masks(
        disc[None, None, None], inputs["original_sizes"], inputs["reshaped_input_sizes"], binarize=True
    )[0][0, 0]
    content = compute_content_size(photo, *image.shape[:2])
    found = resize_logits(disc[None], (content[0] / EDGE, content[1] / EDGE), *image.shape[:2])[0] > 0
    assert (found & expected).sum() > 0.98 * (found | expected).sum() > 2000


def test_the_model_is_asked_at_the_points_of_the_photo(model_folder):
    image, points = painted_clip("nowhere").frames[0].load_image(), build_grid(160, 90, 3)
    model, photo = load_model(model_folder)
    keep_all = Thresholds(predicted_iou=-9.0, stability=-1.0, overlap=1.0)
    found = Proposer(model, photo, "cpu", 4, keep_all).propose(image, points, 1, prefer_large=False)
    scale = np.array([EDGE / 160, EDGE / (160 if photo.keeps_shape else 90)])
    with torch.inference_mode():
        asked = torch.from_numpy(points * scale).float()[None, :, None]
        output = model(torch.from_numpy(prepare_photo(image, photo))[None], input_points=asked)
    content = (36 / EDGE if photo.keeps_shape else 1.0, 1.0)
    expected = resize_logits(output.pred_masks.flatten(0, 2), content, 90, 160).numpy() > 0
    expected = [mask for mask in expected if mask.any()]
    assert len(found) == len(expected) > 15
    for mask in expected:
        nearest = (found.masks ^ mask).sum(axis=(1, 2)).min()
        assert nearest <= 0.005 * mask.size, "asked all at once, logits near zero may round to the other side"


def test_points_lie_in_the_middle_of_equal_cells():
    np.testing.assert_allclose(build_grid(8, 4, 2), [[2, 1], [6, 1], [2, 3], [6, 3]])


def test_photos_are_padded_or_stretched_as_the_family_wants():
    image = np.full((30, 60, 3), 255, np.uint8)
    padded = PhotoFormat(20, True, (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))
    assert compute_content_size(padded, 30, 60) == (10, 20)
    square = prepare_photo(image, padded)
    assert square.shape == (3, 20, 20)
    assert (square[:, :10] == 2).all()
    assert not square[:, 10:].any()
    stretched = replace(padded, keeps_shape=False)
    assert compute_content_size(stretched, 30, 60) == (20, 20)
    assert (prepare_photo(image, stretched) == 2).all()


def test_logits_are_read_where_the_photo_lies_in_the_square():
    logits = torch.zeros(1, 4, 4)
    logits[0, :2, 2:] = 8.0  # the upper right quarter
    upper_half = resize_logits(logits, (0.5, 1.0), 4, 8)[0]
    assert (upper_half[:3, 5:] == 8).all()
    assert (upper_half[:, :3] == 0).all()
    torch.testing.assert_close(upper_half[:3, 3:5], torch.tensor([[2.0, 6.0]] * 3))
    assert (upper_half[3, 5:] == 6).all(), "a quarter of a mask pixel from what lies below"


def test_stability_counts_how_little_the_border_moves():
    logits = torch.tensor([[[5.0, 0.5, -0.5, -5.0]], [[5.0, 5.0, -5.0, -5.0]], [[-5.0, -5.0, -5.0, -5.0]]])
    torch.testing.assert_close(compute_stability(logits), torch.tensor([1 / 3, 1.0, 0.0]))
