"""Pictures as data URIs, so that a page is one file."""

from __future__ import annotations

import base64
import io

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.evaluation.page.elements import Markup, element

MAX_WIDTH = 480
"""Pixels; wider pictures are shrunk."""
JPEG_QUALITY = 82


def photo_picture(image: UInt8[ndarray, "h w 3"], text: str, **attributes: str) -> Markup:
    """An ``img`` of a photo (JPEG)."""
    picture = Image.fromarray(np.ascontiguousarray(image))
    if picture.width > MAX_WIDTH:
        picture = picture.resize(_shrunk(picture), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=JPEG_QUALITY, optimize=True)
    return _picture("jpeg", buffer.getvalue(), picture, text, attributes)


def map_picture(colors: UInt8[ndarray, "h w 3"], text: str, **attributes: str) -> Markup:
    """An ``img`` of a map of flat colours (PNG, exact; with a palette where 256 colours are enough)."""
    picture = Image.fromarray(np.ascontiguousarray(colors))
    if picture.width > MAX_WIDTH:
        picture = picture.resize(_shrunk(picture), Image.Resampling.NEAREST)
    buffer = io.BytesIO()
    _with_palette(picture).save(buffer, "PNG", optimize=True)
    return _picture("png", buffer.getvalue(), picture, text, attributes)


def as_bytes(image: Float[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    """An image in [0, 1] as 8-bit RGB."""
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)


def _picture(kind: str, content: bytes, picture: Image.Image, text: str, attributes: dict[str, str]) -> Markup:
    source = f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
    return element("img", src=source, width=picture.width, height=picture.height, alt=text, title=text, **attributes)


def _with_palette(picture: Image.Image) -> Image.Image:
    pixels = np.asarray(picture).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    colors, index = np.unique(pixels, return_inverse=True)
    if len(colors) > 256:
        return picture
    paletted = Image.fromarray(index.reshape(pixels.shape).astype(np.uint8))
    paletted.putpalette(np.stack([colors >> 16, colors >> 8 & 255, colors & 255], -1).astype(np.uint8).tobytes())
    return paletted


def _shrunk(picture: Image.Image) -> tuple[int, int]:
    return MAX_WIDTH, max(1, round(picture.height * MAX_WIDTH / picture.width))
