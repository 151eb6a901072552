"""Putting pictures together: titles, rows, and JPEGs of a limited size."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image, ImageDraw, ImageFont

from instdrive_core.files.atomic import write_bytes

MAX_BYTES = 400_000
_GAP = 4


def banner(picture: UInt8[ndarray, "h w 3"], title: str) -> UInt8[ndarray, "k w 3"]:
    """The picture under a white line with its title."""
    size = max(9, picture.shape[1] // 40)
    line = Image.new("RGB", (picture.shape[1], 2 * size), "white")
    ImageDraw.Draw(line).text((size // 2, size // 3), title, "black", font=ImageFont.load_default(size))
    return np.concatenate([np.asarray(line), picture])


def beside(pictures: Sequence[UInt8[ndarray, "h w 3"]]) -> UInt8[ndarray, "h k 3"]:
    """Pictures of one height from left to right, with a white gap."""
    gap = np.full((pictures[0].shape[0], _GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (picture, gap)]
    return np.concatenate(parts[:-1], axis=1)


def fit_picture(picture: UInt8[ndarray, "h w 3"], width: int, height: int) -> UInt8[ndarray, "height width 3"]:
    """The picture scaled into a white frame, its proportions kept."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    frame = Image.new("RGB", (width, height), "white")
    sized = Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS)
    frame.paste(sized, ((width - size[0]) // 2, (height - size[1]) // 2))
    return np.asarray(frame)


def save_jpeg(pixels: UInt8[ndarray, "h w 3"], target: Path, max_bytes: int = MAX_BYTES) -> None:
    """Write the best JPEG that fits into `max_bytes`: quality 90 down to 60, then smaller and smaller."""
    picture = Image.fromarray(pixels)
    picture.thumbnail((2400, 2400), Image.Resampling.LANCZOS)
    while True:
        for quality in (90, 82, 74, 66, 60):
            content = BytesIO()
            picture.save(content, "JPEG", quality=quality)
            if content.tell() <= max_bytes:
                target.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(target, content.getvalue())
                return
        picture = picture.resize((picture.width * 4 // 5, picture.height * 4 // 5), Image.Resampling.LANCZOS)
