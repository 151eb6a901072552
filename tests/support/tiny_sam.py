"""Tiny random models of the Segment Anything families, as their own libraries save them."""

import json

import torch

from instdrive_core.masks.sam.options import SamOptions

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


def permissive(folder, **changes):
    """Random models believe in nothing: take what they give."""
    usual = {"points_per_side": 5, "batch": 7, "predicted_iou": 0.5, "stability": 0.5, "device": "cpu", "offline": True}
    usual |= {"whole_objects": False, "overlap": 1.0}
    return SamOptions(str(folder), **(usual | changes))
