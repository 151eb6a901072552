"""A picture per camera to judge masks by: photos spread over the clip, each mask in a colour of its own, outlined."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8, UInt16
from numpy import ndarray
from PIL import Image, ImageDraw, ImageFont

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError, OptionError
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.masks.label_map_folder import FrameMasks, MaskFolder
from instdrive_core.wording import format_count

COLUMNS, ROWS = 3, 3
MAX_WIDTH = 640
"""Pixels of a photo in the sheet."""
GAP, BACKGROUND = 4, (24, 24, 24)
MASK_SHARE = 0.6
"""Share of a pixel that is the mask's colour; the rest is the photo."""
HATCH = 8
"""Pixels between the lines that mark the sky."""


def write_contact_sheets(clip: Clip, masks: MaskFolder, path: Path) -> tuple[Path, ...]:
    """Write a sheet per camera and return their files.

    Args:
        clip: photos and cameras.
        masks: masks of the clip's training photos.
        path: picture file, or a folder, which gets CAMERA.jpg; with several cameras, a file's name gets theirs as well.

    Raises OptionError for a file name that is no picture's, DataError where a file cannot be written or masks are
    damaged.
    """
    by_camera: dict[str, list[Frame]] = {}
    for frame in clip.training_frames:
        if frame.key in masks.counts:
            by_camera.setdefault(frame.view.name, []).append(frame)
    files = [_name_sheet(path, name, alone=len(by_camera) == 1) for name in by_camera]
    for file, frames in zip(files, by_camera.values(), strict=True):
        picture = build_contact_sheet(frames, masks)
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            picture.save(file, quality=85)
        except OSError as error:
            problem = f"cannot be written ({error.strerror or error})"
            raise DataError(file, problem, "Choose another place for --sheet") from error
    return tuple(files)


def check_sheet_path(path: Path) -> None:
    """Raise OptionError for a file name that is no picture's, before any work is done."""
    if path.suffix and path.suffix.lower() not in (".jpg", ".jpeg", ".png"):
        raise OptionError(f"--sheet {path}: a picture is .jpg or .png, a folder has no ending")


def build_contact_sheet(frames: Sequence[Frame], masks: MaskFolder) -> Image.Image:
    """Put together up to `COLUMNS` × `ROWS` photos of one camera, evenly spread over the frames, in their order."""
    count = min(len(frames), COLUMNS * ROWS)
    chosen = [frames[round(number * (len(frames) - 1) / max(1, count - 1))] for number in range(count)]
    tiles = [_build_tile(frame, masks.load(frame)) for frame in chosen]
    width, height = (max(tile.size[side] for tile in tiles) + GAP for side in (0, 1))
    columns = min(COLUMNS, count)
    sheet = Image.new("RGB", (columns * width + GAP, math.ceil(count / columns) * height + GAP), BACKGROUND)
    for number, tile in enumerate(tiles):
        sheet.paste(tile, (GAP + number % columns * width, GAP + number // columns * height))
    return sheet


def paint_masks(image: UInt8[ndarray, "h w 3"], masks: FrameMasks) -> UInt8[ndarray, "h w 3"]:
    """Paint masks over a photo: outlines white, the sky hatched, what has no mask dark and without colour."""
    grey = image.mean(axis=2, keepdims=True)
    labels = masks.labels
    colored = MASK_SHARE * colors_from_ids(labels.astype(np.uint32)) + (1 - MASK_SHARE) * grey
    picture = np.where((labels > 0)[..., None], colored, 0.45 * grey)
    picture[masks.sky & _build_hatching(labels.shape)] = 220
    picture[_find_outlines(labels)] = 255
    return picture.astype(np.uint8)


def _build_tile(frame: Frame, masks: FrameMasks) -> Image.Image:
    tile = Image.fromarray(paint_masks(frame.load_image(), masks))
    if tile.width > MAX_WIDTH:
        tile = tile.resize((MAX_WIDTH, round(tile.height * MAX_WIDTH / tile.width)), Image.Resampling.LANCZOS)
    count = len(np.unique(masks.labels[masks.labels > 0]))
    text = f"{frame.key}: {format_count(count, 'mask')}"
    draw, font = ImageDraw.Draw(tile), ImageFont.load_default(max(9, tile.width // 32))
    left, top, right, bottom = draw.textbbox((6, 4), text, font)
    draw.rectangle((left - 4, top - 3, right + 4, bottom + 3), fill=(0, 0, 0))
    draw.text((6, 4), text, (255, 255, 255), font)
    return tile


def _find_outlines(labels: UInt16[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    """Find pixels of a mask whose right or lower neighbour is not of it."""
    outline = np.zeros(labels.shape, bool)
    outline[:, :-1] |= labels[:, :-1] != labels[:, 1:]
    outline[:-1] |= labels[:-1] != labels[1:]
    return outline


def _build_hatching(shape: tuple[int, ...]) -> Bool[ndarray, "h w"]:
    """Diagonal lines."""
    return np.indices(shape).sum(axis=0) % HATCH == 0


def _name_sheet(path: Path, camera: str, alone: bool) -> Path:
    if not path.suffix:
        return path / f"{camera}.jpg"
    return path if alone else path.with_stem(f"{path.stem}_{camera}")
