"""Where models come from: folders and names, damaged and incomplete files, and options that cannot be."""

import json
import shutil

import numpy as np
import pytest
import torch
from painted_street import painted_clip
from safetensors.numpy import load_file, save_file
from tiny_sam import EDGE, permissive, write_tiny_model

from instdrive_core.errors import DataError, OptionError
from instdrive_core.masks.sam import weights as sam_weights
from instdrive_core.masks.sam.labels import SamLabels
from instdrive_core.masks.sam.options import SamOptions
from instdrive_core.masks.sam.weights import IMAGENET_MEAN, IMAGENET_STD, PhotoFormat, find_weights, load_model

pytestmark = pytest.mark.usefixtures("one_thread")


def test_a_folder_that_is_not_there_says_how_to_get_weights():
    with pytest.raises(DataError, match=r"no such folder.*hf download facebook/sam2.*safetensors"):
        find_weights("weights/sam/large", offline=True)


def test_a_name_that_is_not_on_this_machine_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(OptionError, match=r"facebook/none.*hf download facebook/none.*edgetam.*sam2.*sam_hq"):
        find_weights("facebook/none", offline=True)


def test_a_name_that_the_hub_does_not_give_says_why(tmp_path, monkeypatch):
    def unreachable(name, allow_patterns, local_files_only):
        raise OSError("not cached" if local_files_only else "no route to host")

    monkeypatch.setattr("huggingface_hub.snapshot_download", unreachable)
    with pytest.raises(OptionError, match=r"no route to host.*hf download facebook/none"):
        find_weights("facebook/none", offline=False)


def test_a_name_is_downloaded_once(tmp_path, monkeypatch, sam_folder):
    asked = []

    def hub(name, allow_patterns, local_files_only):
        asked.append((name, local_files_only))
        if local_files_only:
            raise OSError("not cached")
        return str(sam_folder)

    monkeypatch.setattr("huggingface_hub.snapshot_download", hub)
    assert find_weights("somebody/sam", offline=False) == sam_folder
    assert asked == [("somebody/sam", True), ("somebody/sam", False)]


def test_a_folder_without_weights_is_refused(tmp_path, sam_folder):
    with pytest.raises(DataError, match=r"'config\.json' is missing"):
        find_weights(str(tmp_path), offline=True)
    shutil.copy(sam_folder / "config.json", tmp_path)
    with pytest.raises(DataError, match=r"'\*.safetensors' is missing"):
        find_weights(str(tmp_path), offline=True)


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
    assert photo == PhotoFormat(EDGE, False, (0.4, 0.4, 0.4), (0.2, 0.2, 0.2))


def test_photos_are_normalised_as_the_models_files_say(tmp_path, sam_folder):
    _, photo = load_model(sam_folder)
    assert photo == PhotoFormat(EDGE, True, IMAGENET_MEAN, IMAGENET_STD)
    shutil.copytree(sam_folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "preprocessor_config.json").unlink()
    nested = {"image_processor": {"image_mean": [0.1, 0.2, 0.3], "image_std": [1, 1, 1]}}
    (tmp_path / "processor_config.json").write_text(json.dumps(nested))
    assert load_model(tmp_path)[1] == PhotoFormat(EDGE, True, (0.1, 0.2, 0.3), (1.0, 1.0, 1.0))


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
