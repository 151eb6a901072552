"""Pictures of a preview to look at: colour, instances, codewords or depth."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray

from instdrive_core.instances.colormap import ID_LIMIT, colors_from_ids
from instdrive_core.rasterize.preview import Preview
from instdrive_core.rasterize.scene_view import build_instance_map
from instdrive_core.scene.scene import Scene

Mode = Literal["color", "instance", "codeword", "depth"]
_RAMP = np.array(
    [[48, 18, 59], [66, 120, 240], [27, 208, 213], [114, 250, 92], [237, 208, 58], [251, 114, 27], [122, 4, 3]]
)
"""Colours from near to far, evenly spaced in the logarithm of depth."""


def colorize_preview(scene: Scene, shown: Preview, mode: Mode) -> UInt8[ndarray, "h w 3"]:
    """Draw the pixels of one mode; IDs in exact colours, depth as a ramp over the logarithm of the depths present."""
    match mode:
        case "color":
            return np.round(np.clip(shown.color, 0, 1) * 255).astype(np.uint8)
        case "instance":
            return colors_from_ids(build_instance_map(scene, shown))
        case "codeword":
            # As in the editor: the colour map holds 24 bits, a longer codeword shows its low ones.
            codewords = np.zeros(shown.winner.shape, np.uint32)
            codewords[shown.winner >= 0] = scene.codewords[shown.winner[shown.winner >= 0]]
            return colors_from_ids(codewords & np.uint32(ID_LIMIT - 1))
        case "depth":
            return colorize_depth(shown.depth, shown.alpha >= 0.5)


def cut_out_preview(scene: Scene, shown: Preview, mode: Mode) -> UInt8[ndarray, "h w 4"]:
    """Draw the pixels of one mode as RGBA: see-through where no splat is. Draw `shown` without a sky.

    Colours are not premultiplied. Pixels of other modes than colour are there or not.
    """
    if mode == "color":
        alpha = np.clip(shown.alpha, 0, 1)[..., None]
        color = np.clip(shown.color / np.maximum(alpha, 1e-6), 0, 1)
        return np.round(np.concatenate([color, alpha], axis=-1) * 255).astype(np.uint8)
    picture = colorize_preview(scene, shown, mode)
    there = picture.any(axis=-1, keepdims=True)
    return np.concatenate([picture, np.where(there, 255, 0).astype(np.uint8)], axis=-1)


def colorize_depth(depth: Float[ndarray, "h w"], there: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    """Draw depth in colours: near violet, far red, nothing black; the ramp spans 1 % to 99 % of the depths present."""
    colors = np.zeros((*depth.shape, 3), np.uint8)
    if there.any():
        logs = np.log(np.maximum(depth[there], 1e-6))
        near, far = np.quantile(logs, [0.01, 0.99])
        places = np.clip((logs - near) / max(far - near, 1e-6), 0, 1) * (len(_RAMP) - 1)
        channels = [np.interp(places, np.arange(len(_RAMP)), _RAMP[:, channel]) for channel in range(3)]
        colors[there] = np.round(np.stack(channels, axis=-1))
    return colors
