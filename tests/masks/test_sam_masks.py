"""Segment Anything end to end with tiny random models, and what becomes of its masks with ones made by hand."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from painted_street import ROAD, SKY, painted_clip, truth
from safetensors.numpy import load_file, save_file

from instdrive_core.errors import DataError, OptionError
from instdrive_core.masks import sam_weights
from instdrive_core.masks.sam import SamLabels, SamOptions
from instdrive_core.masks.sam_proposals import (
    Proposer,
    Thresholds,
    at_photo_size,
    content_size,
    grid,
    prepared,
    stability,
)
from instdrive_core.masks.sam_regions import Regions, cleaned, distinct, painted, whole_objects
from instdrive_core.masks.sam_sky import SkyFinder, sky_by_looks
from instdrive_core.masks.sam_weights import IMAGENET_MEAN, IMAGENET_STD, Photo, load_model, weights_folder

EDGE = 64
"""Pixels of the square that the tiny models look at."""
DECODER = {
    "hidden_size": 16,
    "mlp_dim": 32,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
    "iou_head_hidden_dim": 16,
}


def tiny_sam_config(high_quality=False):
    from transformers import SamConfig, SamHQConfig

    vision = {
        "hidden_size": 16,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": EDGE,
        "patch_size": 8,
        "output_channels": 16,
        "window_size": 4,
        "global_attn_indexes": [1],
        "mlp_dim": 32,
        "num_pos_feats": 8,
    }
    prompts = {"hidden_size": 16, "image_size": EDGE, "patch_size": 8, "mask_input_channels": 4}
    if high_quality:
        return SamHQConfig(
            vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=DECODER | {"vit_dim": 16}
        )
    return SamConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=DECODER)


def tiny_sam2_config():
    from transformers import Sam2Config

    backbone = {
        "model_type": "sam2_hiera_det_model",
        "hidden_size": 8,
        "num_attention_heads": 1,
        "image_size": [EDGE, EDGE],
        "blocks_per_stage": [1, 1, 2, 1],
        "embed_dim_per_stage": [8, 16, 32, 64],
        "num_attention_heads_per_stage": [1, 1, 2, 2],
        "window_size_per_stage": [4, 2, 4, 2],
        "global_attention_blocks": [3],
        "window_positional_embedding_background_size": [4, 4],
    }
    vision = {
        "backbone_config": backbone,
        "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
        "fpn_hidden_size": 16,
    }
    prompts = {"hidden_size": 16, "image_size": EDGE, "patch_size": 16, "mask_input_channels": 4}
    return Sam2Config(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=DECODER)


def tiny_sam3_config():
    from transformers import Sam3TrackerConfig

    backbone = {
        "model_type": "sam3_vit_model",
        "hidden_size": 16,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": EDGE,
        "patch_size": 16,
        "window_size": 2,
        "global_attn_indexes": [1],
        "pretrain_image_size": 32,
    }
    sizes = [[16, 16], [8, 8], [4, 4]]
    vision = {"backbone_config": backbone, "fpn_hidden_size": 16, "backbone_feature_sizes": sizes}
    prompts = {"hidden_size": 16, "image_size": EDGE, "patch_size": 16, "mask_input_channels": 4}
    return Sam3TrackerConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=DECODER)


CONFIGS = {
    "sam": tiny_sam_config,
    "sam_hq": lambda: tiny_sam_config(high_quality=True),
    "sam2": tiny_sam2_config,
    "sam3_tracker": tiny_sam3_config,
}


def write_tiny_model(folder, kind):
    """Random weights of a family and what its processor writes next to them."""
    from transformers import AutoModelForMaskGeneration
    from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil

    torch.manual_seed(3)
    config = CONFIGS[kind]()
    model = AutoModelForMaskGeneration.from_config(config)
    with torch.no_grad():  # as initialised, all is nearly zero: random masks with sharp borders, believed in
        for name, parameter in model.named_parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
            if "hypernetworks_mlps" in name and "proj_out" in name:
                parameter.mul_(3000.0)
            if "iou_prediction_head.proj_out.bias" in name:
                parameter.fill_(2.0)
    model.save_pretrained(folder)
    if kind not in ("sam", "sam_hq"):  # its processor needs torchvision; this is what it writes
        settings = {"image_processor_type": "Sam2ImageProcessor", "size": {"height": EDGE, "width": EDGE}}
        settings |= {"image_mean": [0.4] * 3, "image_std": [0.2] * 3}
        (folder / "preprocessor_config.json").write_text(json.dumps(settings))
    else:
        square = {"height": EDGE, "width": EDGE}
        SamImageProcessorPil(size={"longest_edge": EDGE}, pad_size=square).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module", autouse=True)
def _one_thread():
    """Tiny tensors are faster without others' help."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module", params=list(CONFIGS))
def model_folder(request, tmp_path_factory):
    return write_tiny_model(tmp_path_factory.mktemp(request.param), request.param)


@pytest.fixture(scope="module")
def sam_folder(tmp_path_factory):
    return write_tiny_model(tmp_path_factory.mktemp("sam"), "sam")


def permissive(folder, **changes):
    """Random models believe in nothing: take what they give."""
    usual = {"points_per_side": 5, "batch": 7, "predicted_iou": 0.5, "stability": 0.5, "device": "cpu", "offline": True}
    usual |= {"whole_objects": False, "overlap": 1.0}
    return SamOptions(str(folder), **(usual | changes))


def test_a_model_saved_to_disk_labels_photos(model_folder):
    clip = painted_clip("nowhere")
    labels = SamLabels(clip, permissive(model_folder))
    frame = clip.frames[0]
    found, sky = labels.load(frame), labels.sky(frame)
    assert found.shape == sky.shape == (90, 160)
    assert found.dtype == np.uint32
    assert sky.dtype == bool
    assert len(np.unique(found[found > 0])) > 1, "a random model draws a few things, here and there"
    assert (found[sky] == 0).all()


def test_same_photo_same_bits_whatever_came_before(model_folder):
    clip = painted_clip("nowhere")
    forth, back = (SamLabels(clip, permissive(model_folder)) for _ in range(2))
    first = [(forth.load(frame), forth.sky(frame)) for frame in clip.frames[:2]]
    second = [(back.load(frame), back.sky(frame)) for frame in clip.frames[1::-1]]
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
    assert not labels.sky(frame)[60:].any()


def test_photos_and_masks_are_brought_to_size_as_the_library_does(sam_folder):
    from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil

    image = painted_clip("nowhere").frames[0].load_image()
    processor, photo = SamImageProcessorPil.from_pretrained(sam_folder), load_model(sam_folder)[1]
    inputs = processor(images=image, return_tensors="pt")
    np.testing.assert_allclose(prepared(image, photo), inputs["pixel_values"][0].numpy(), atol=1e-5)
    rows, columns = torch.meshgrid(torch.arange(32.0), torch.arange(32.0), indexing="ij")
    disc = 40 - (rows - 9) ** 2 - (columns - 14) ** 2
    expected = processor.post_process_masks(
        disc[None, None, None], inputs["original_sizes"], inputs["reshaped_input_sizes"], binarize=True
    )[0][0, 0]
    content = content_size(photo, *image.shape[:2])
    found = at_photo_size(disc[None], (content[0] / EDGE, content[1] / EDGE), *image.shape[:2])[0] > 0
    assert (found & expected).sum() > 0.98 * (found | expected).sum() > 2000


def test_the_model_is_asked_at_the_points_of_the_photo(model_folder):
    image, points = painted_clip("nowhere").frames[0].load_image(), grid(160, 90, 3)
    model, photo = load_model(model_folder)
    keep_all = Thresholds(predicted_iou=-9.0, stability=-1.0, overlap=1.0)
    found = Proposer(model, photo, "cpu", 4, keep_all).propose(image, points, 1, prefer_large=False)
    scale = np.array([EDGE / 160, EDGE / (160 if photo.keeps_shape else 90)])
    with torch.inference_mode():
        asked = torch.from_numpy(points * scale).float()[None, :, None]
        output = model(torch.from_numpy(prepared(image, photo))[None], input_points=asked)
    content = (36 / EDGE if photo.keeps_shape else 1.0, 1.0)
    expected = at_photo_size(output.pred_masks.flatten(0, 2), content, 90, 160).numpy() > 0
    expected = [mask for mask in expected if mask.any()]
    assert len(found) == len(expected) > 15
    for mask in expected:
        nearest = (found.masks ^ mask).sum(axis=(1, 2)).min()
        assert nearest <= 0.005 * mask.size, "asked all at once, logits near zero may round to the other side"


def test_points_lie_in_the_middle_of_equal_cells():
    np.testing.assert_allclose(grid(8, 4, 2), [[2, 1], [6, 1], [2, 3], [6, 3]])


def test_photos_are_padded_or_stretched_as_the_family_wants():
    image = np.full((30, 60, 3), 255, np.uint8)
    padded = Photo(20, True, (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))
    assert content_size(padded, 30, 60) == (10, 20)
    square = prepared(image, padded)
    assert square.shape == (3, 20, 20)
    assert (square[:, :10] == 2).all()
    assert not square[:, 10:].any()
    stretched = replace(padded, keeps_shape=False)
    assert content_size(stretched, 30, 60) == (20, 20)
    assert (prepared(image, stretched) == 2).all()


def test_logits_are_read_where_the_photo_lies_in_the_square():
    logits = torch.zeros(1, 4, 4)
    logits[0, :2, 2:] = 8.0  # the upper right quarter
    upper_half = at_photo_size(logits, (0.5, 1.0), 4, 8)[0]
    assert (upper_half[:3, 5:] == 8).all()
    assert (upper_half[:, :3] == 0).all()
    torch.testing.assert_close(upper_half[:3, 3:5], torch.tensor([[2.0, 6.0]] * 3))
    assert (upper_half[3, 5:] == 6).all(), "a quarter of a mask pixel from what lies below"


def test_stability_counts_how_little_the_border_moves():
    logits = torch.tensor([[[5.0, 0.5, -0.5, -5.0]], [[5.0, 5.0, -5.0, -5.0]], [[-5.0, -5.0, -5.0, -5.0]]])
    torch.testing.assert_close(stability(logits), torch.tensor([1 / 3, 1.0, 0.0]))


def box(top, bottom, left, right, shape=(20, 40)):
    """A mask that fills a rectangle."""
    mask = np.zeros(shape, bool)
    mask[top:bottom, left:right] = True
    return mask


def regions(*masks, scores=None):
    return Regions(np.array(masks), np.array(scores if scores else [0.9] * len(masks), np.float32))


CAR, WHEEL, DOOR, HUB = box(5, 15, 5, 20), box(11, 15, 6, 10), box(6, 13, 11, 16), box(12, 14, 7, 9)


def assert_masks(found, *expected):
    assert sorted(mask.tobytes() for mask in found.masks) == sorted(mask.tobytes() for mask in expected)


def test_parts_join_the_whole_and_so_do_their_parts():
    assert_masks(whole_objects(regions(WHEEL, CAR, HUB, DOOR), 0.85), CAR)


def test_what_pokes_out_of_the_whole_belongs_to_it():
    wheel = box(11, 16, 6, 10)  # the lowest of its 5 rows is outside
    assert_masks(whole_objects(regions(wheel, CAR), 0.75), CAR | wheel)
    assert_masks(whole_objects(regions(wheel, CAR), 0.85), CAR, wheel)


def test_a_whole_that_the_model_trusts_less_takes_nothing_in():
    assert_masks(whole_objects(regions(WHEEL, CAR, scores=[0.98, 0.9]), 0.85), WHEEL, CAR)
    assert_masks(whole_objects(regions(WHEEL, CAR, scores=[0.94, 0.9]), 0.85), CAR)


def test_a_mask_of_the_scene_is_no_whole():
    scene = box(2, 20, 0, 40)
    assert_masks(whole_objects(regions(CAR, scene), 0.85), CAR, scene)


def test_a_row_of_cars_is_several_unless_the_model_trusts_the_row_more():
    left, right = box(5, 15, 5, 15), box(5, 15, 15, 25)
    row, almost = left | right, (left | right) & ~box(5, 6, 5, 8)
    assert_masks(whole_objects(regions(left, right, row, almost, scores=[0.95, 0.95, 0.92, 0.92]), 0.85), left, right)
    assert_masks(whole_objects(regions(left, right, row, scores=[0.92, 0.92, 0.95]), 0.85), row)


def test_an_object_with_a_main_part_is_no_group():
    body, windows = box(8, 15, 5, 20), box(5, 8, 5, 20)
    assert_masks(whole_objects(regions(body, windows, CAR, scores=[0.92, 0.92, 0.9]), 0.85), CAR)


def test_two_objects_that_overlap_a_little_stay_two():
    left, right = box(5, 15, 5, 15), box(5, 15, 13, 25)
    assert_masks(whole_objects(regions(left, right), 0.85), left, right)


def test_of_duplicates_the_best_is_kept_or_the_fuller_one_where_wholes_are_wanted():
    boxes = np.array([[0, 0, 10, 10], [0, 0, 10, 10], [0, 0, 10, 8], [20, 0, 30, 10]], np.float32)
    areas, scores = np.array([70, 95, 80, 60]), np.array([0.93, 0.91, 0.8, 0.92], np.float32)
    assert distinct(boxes, areas, scores, 0.7, prefer_large=False).tolist() == [0, 3]
    assert distinct(boxes, areas, scores, 0.7, prefer_large=True).tolist() == [1, 3]
    worse = np.array([0.97, 0.91, 0.8, 0.92], np.float32)
    assert distinct(boxes, areas, worse, 0.7, prefer_large=True).tolist() == [0, 3]
    assert distinct(boxes, areas, scores, 1.0, prefer_large=False).tolist() == [0, 3, 1, 2]


def test_holes_and_islands_go_and_so_does_what_lies_on_the_ego_vehicle():
    holed = CAR & ~box(7, 9, 7, 9)
    island = box(0, 1, 35, 38)
    hood, straddling = box(15, 20, 25, 35), box(10, 17, 25, 35)
    valid = ~box(15, 20, 0, 40)
    found = cleaned(regions(holed | island, hood, straddling, island, scores=[0.9, 0.8, 0.7, 0.6]), valid, 5)
    assert_masks(found, CAR, box(10, 15, 25, 35))
    np.testing.assert_allclose(found.scores, [0.9, 0.7])
    large_hole = CAR & ~box(7, 10, 7, 9)
    assert_masks(cleaned(regions(large_hole), valid, 5), large_hole)


def test_small_is_painted_over_large_and_crumbs_are_nobodys():
    road, wheel = box(4, 16, 4, 21), box(15, 19, 6, 10)
    labels = painted(regions(wheel, road, CAR), 10)
    expected = np.zeros((20, 40), np.uint32)
    expected[road] = 2
    expected[CAR] = 3
    expected[wheel] = 1
    np.testing.assert_array_equal(labels, expected)
    labels = painted(regions(wheel, road, CAR), 60)
    assert set(np.unique(labels)) == {0, 3}, "a rim of 54 pixels and a wheel of 16 are crumbs"


def test_no_masks_at_all_are_fine():
    nothing = Regions(np.zeros((0, 20, 40), bool), np.zeros(0, np.float32))
    assert len(cleaned(nothing, np.ones((20, 40), bool), 3)) == len(whole_objects(nothing, 0.85)) == 0
    assert not painted(nothing, 3).any()
    boxes = np.zeros((0, 4), np.float32)
    assert len(distinct(boxes, np.zeros(0, np.int64), np.zeros(0, np.float32), 0.7, prefer_large=True)) == 0


def test_the_sky_is_the_mask_that_lidar_looks_through():
    clip = painted_clip("nowhere")
    frame, sky = clip.frames[0], truth(clip.frames[0].view.time) == SKY
    labels = np.where(sky, 1, 2).astype(np.uint32)
    found = SkyFinder(clip).find(frame.load_image(), frame.view.camera, labels)
    np.testing.assert_array_equal(found, sky)
    unlabelled = SkyFinder(clip).find(frame.load_image(), frame.view.camera, np.zeros_like(labels))
    assert (unlabelled & ~sky).sum() == 0
    assert unlabelled.sum() > 0.7 * sky.sum(), "what no mask claims is found too"


def test_without_lidar_the_sky_is_what_looks_and_lies_like_it():
    clip = replace(painted_clip("nowhere"), sweeps=())
    frame, classes = clip.frames[0], truth(clip.frames[0].view.time)
    found = SkyFinder(clip).find(frame.load_image(), frame.view.camera, (classes + 1).astype(np.uint32))
    np.testing.assert_array_equal(found, classes == SKY)
    labels = np.ones_like(classes, np.uint32)
    assert not sky_by_looks(frame.load_image(), frame.view.camera, labels).any(), "reaches below the horizon"
    dark = (frame.load_image() // 4).astype(np.uint8)
    dark[classes == ROAD] = 200
    assert not sky_by_looks(dark, frame.view.camera, (classes + 1).astype(np.uint32)).any(), "darker than the road"


def test_a_sky_between_branches_is_smooth_where_it_is_wide():
    clip = replace(painted_clip("nowhere"), sweeps=())
    frame, classes = clip.frames[0], truth(clip.frames[0].view.time)
    image, labels = frame.load_image(), (classes + 1).astype(np.uint32)
    for row in range(2, 30, 4):
        image[row], labels[row] = 20, 99
    found = sky_by_looks(image, frame.view.camera, labels)
    np.testing.assert_array_equal(found, labels == SKY + 1)
    noisy = image.copy()
    noisy[::2, ::2][labels[::2, ::2] == SKY + 1] = 100
    assert not sky_by_looks(noisy, frame.view.camera, labels).any()


def test_a_folder_that_is_not_there_says_how_to_get_weights():
    with pytest.raises(DataError, match=r"no such folder.*hf download facebook/sam2.*safetensors"):
        weights_folder("weights/sam/large", offline=True)


def test_a_name_that_is_not_on_this_machine_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(OptionError, match=r"facebook/none.*hf download facebook/none.*edgetam.*sam2.*sam_hq"):
        weights_folder("facebook/none", offline=True)


def test_a_name_that_the_hub_does_not_give_says_why(tmp_path, monkeypatch):
    def unreachable(name, allow_patterns, local_files_only):
        raise OSError("not cached" if local_files_only else "no route to host")

    monkeypatch.setattr("huggingface_hub.snapshot_download", unreachable)
    with pytest.raises(OptionError, match=r"no route to host.*hf download facebook/none"):
        weights_folder("facebook/none", offline=False)


def test_a_name_is_downloaded_once(tmp_path, monkeypatch, sam_folder):
    asked = []

    def hub(name, allow_patterns, local_files_only):
        asked.append((name, local_files_only))
        if local_files_only:
            raise OSError("not cached")
        return str(sam_folder)

    monkeypatch.setattr("huggingface_hub.snapshot_download", hub)
    assert weights_folder("somebody/sam", offline=False) == sam_folder
    assert asked == [("somebody/sam", True), ("somebody/sam", False)]


def test_a_folder_without_weights_is_refused(tmp_path, sam_folder):
    with pytest.raises(DataError, match=r"'config\.json' is missing"):
        weights_folder(str(tmp_path), offline=True)
    shutil.copy(sam_folder / "config.json", tmp_path)
    with pytest.raises(DataError, match=r"'\*.safetensors' is missing"):
        weights_folder(str(tmp_path), offline=True)


def test_a_model_of_another_kind_is_refused(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    (tmp_path / "model.safetensors").write_bytes(b"")
    with pytest.raises(DataError, match=r"'bert', which does not generate masks.*sam2"):
        load_model(tmp_path)


def test_damaged_and_incomplete_weights_are_refused(tmp_path, sam_folder):
    shutil.copytree(sam_folder, tmp_path, dirs_exist_ok=True)
    weights = load_file(tmp_path / "model.safetensors")
    lost = next(name for name in weights if name.startswith("vision_encoder"))
    kept = {name: value for name, value in weights.items() if name != lost}
    save_file(kept, tmp_path / "model.safetensors", {"format": "pt"})
    with pytest.raises(DataError, match=f"lacks 1 of the model's weights, e.g. '{lost}'"):
        load_model(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"garbage")
    with pytest.raises(DataError, match="cannot be opened as a model of the type 'sam'"):
        load_model(tmp_path)


def test_the_hubs_sam2_is_opened_without_its_memory(tmp_path):
    write_tiny_model(tmp_path, "sam2")
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps(config | {"model_type": "sam2_video"}))
    weights = load_file(tmp_path / "model.safetensors")
    save_file(weights | {"memory_encoder.x": np.zeros(3, np.float32)}, tmp_path / "model.safetensors", {"format": "pt"})
    model, photo = load_model(tmp_path)
    assert type(model).__name__ == "Sam2Model"
    assert photo == Photo(EDGE, False, (0.4, 0.4, 0.4), (0.2, 0.2, 0.2))


def test_photos_are_normalised_as_the_models_files_say(tmp_path, sam_folder):
    _, photo = load_model(sam_folder)
    assert photo == Photo(EDGE, True, IMAGENET_MEAN, IMAGENET_STD)
    shutil.copytree(sam_folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "preprocessor_config.json").unlink()
    nested = {"image_processor": {"image_mean": [0.1, 0.2, 0.3], "image_std": [1, 1, 1]}}
    (tmp_path / "processor_config.json").write_text(json.dumps(nested))
    assert load_model(tmp_path)[1] == Photo(EDGE, True, (0.1, 0.2, 0.3), (1.0, 1.0, 1.0))


def test_without_the_library_it_says_what_to_install(monkeypatch, sam_folder):
    monkeypatch.setattr(sam_weights, "find_spec", lambda name: None)
    with pytest.raises(OptionError, match=r"pip install 'instdrive\[sam\]'"):
        SamLabels(painted_clip("nowhere"), permissive(sam_folder))


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_asked_for_must_be_there(sam_folder):
    with pytest.raises(OptionError, match="no NVIDIA GPU"):
        SamLabels(painted_clip("nowhere"), permissive(sam_folder, device="cuda"))


@pytest.mark.parametrize(
    "wrong", [{"batch": 0}, {"points_per_side": 0}, {"stability": 1.5}, {"min_area": -0.1}, {"containment": 0.5}]
)
def test_impossible_options_are_refused(wrong):
    with pytest.raises(OptionError, match=next(iter(wrong))):
        SamOptions(**wrong)
