"""Pictures as data URIs, so that a page is one file."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image

MAX_WIDTH = 480
"""Pixels; wider pictures are shrunk."""
JPEG_QUALITY = 82


@dataclass(frozen=True)
class Picture:
    """An encoded picture with the text that stands for it."""

    source: str
    """Data URI."""
    width: int
    height: int
    text: str

    @property
    def byte_count(self) -> int:
        """Bytes that the picture takes in a page."""
        return len(self.source)


def encode_photo(image: UInt8[ndarray, "h w 3"], text: str) -> Picture:
    """Encode a photo as JPEG, shrunk to `MAX_WIDTH`."""
    picture = Image.fromarray(np.ascontiguousarray(image))
    if picture.width > MAX_WIDTH:
        picture = picture.resize(_compute_shrunk_size(picture), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=JPEG_QUALITY, optimize=True)
    return _build_picture("jpeg", buffer.getvalue(), picture, text)


def encode_map(colors: UInt8[ndarray, "h w 3"], text: str) -> Picture:
    """Encode a map of flat colours as PNG, exact, with a palette where 256 colours are enough."""
    picture = Image.fromarray(np.ascontiguousarray(colors))
    if picture.width > MAX_WIDTH:
        picture = picture.resize(_compute_shrunk_size(picture), Image.Resampling.NEAREST)
    buffer = io.BytesIO()
    _use_palette(picture).save(buffer, "PNG", optimize=True)
    return _build_picture("png", buffer.getvalue(), picture, text)


def convert_to_bytes(image: Float[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    """Convert an image in [0, 1] to 8-bit RGB."""
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)


def _build_picture(kind: str, content: bytes, picture: Image.Image, text: str) -> Picture:
    source = f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
    return Picture(source, picture.width, picture.height, text)


def _use_palette(picture: Image.Image) -> Image.Image:
    pixels = np.asarray(picture).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    colors, index = np.unique(pixels, return_inverse=True)
    if len(colors) > 256:
        return picture
    paletted = Image.fromarray(index.reshape(pixels.shape).astype(np.uint8))
    paletted.putpalette(np.stack([colors >> 16, colors >> 8 & 255, colors & 255], -1).astype(np.uint8).tobytes())
    return paletted


def _compute_shrunk_size(picture: Image.Image) -> tuple[int, int]:
    return MAX_WIDTH, max(1, round(picture.height * MAX_WIDTH / picture.width))
