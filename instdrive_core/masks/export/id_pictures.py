"""ID maps as PNG pictures: exact colours to look at and select by, and plain numbers for programs.

Layout::

    colors/<camera>/NN.png     the bijective 24-bit colour map
    labels/<camera>/NN.png     IDs: 16-bit grey; R + 256 G + 65536 B where an ID of the scene needs more
    instances.json             what each ID is, and how the pictures are to be read; written last
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8, UInt32
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically, write_bytes
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.masks.export.id_maps import IdMap
from instdrive_core.scene.scene import Scene

LISTING = "instances.json"
GREY, PACKED = "16-bit grey: the value is the ID", "8-bit RGB: R + 256 G + 65536 B is the ID"
"""Forms in which labels may be stored."""


def write_id_pictures(
    folder: Path, scene: Scene, maps: Iterable[IdMap], on_view: Callable[[int], None] = lambda done: None
) -> int:
    """Write the pictures of all maps, each atomically, and the listing at the end; returns how many.

    Raises DataError where the folder cannot be written.
    """
    remove_listing(folder / LISTING)
    packed = int(scene.instance_ids.max(initial=0)) > np.iinfo(np.uint16).max
    frames: list[dict[str, Any]] = []
    for found in maps:
        view = found.view
        key = f"{view.name}/{view.index:02d}"
        save_png(folder / "colors" / f"{key}.png", colors_from_ids(found.ids))
        save_png(folder / "labels" / f"{key}.png", pack_ids(found.ids) if packed else found.ids.astype(np.uint16))
        frames.append({"key": key, "time": view.time, "held_out": view.held_out, "photo": Path(view.photo).name})
        on_view(len(frames))
    listing = {
        "colors": "the bijective colour map of 24-bit IDs; black is no instance",
        "labels": PACKED if packed else GREY,
        "instances": [
            {
                "id": instance.id,
                "name": instance.name,
                "class": instance.class_name,
                "codeword": instance.codeword,
                "color": list(instance.color),
            }
            for instance in scene.table
        ],
        "frames": frames,
    }
    write_bytes(folder / LISTING, (json.dumps(listing, indent=1, ensure_ascii=False) + "\n").encode())
    return len(frames)


def remove_listing(path: Path) -> None:
    """Remove a folder's listing: without it, the folder is unfinished while pictures are written. Raises DataError
    where it stays."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        problem = f"the file of an earlier export cannot be replaced ({error.strerror or error})"
        raise DataError(path, problem, "Choose a folder that can be written") from error


def pack_ids(ids: UInt32[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    """Pack IDs below 2^24 as R + 256 G + 65536 B, COCO's panoptic convention."""
    return np.stack([ids >> shift & 0xFF for shift in (0, 8, 16)], axis=-1).astype(np.uint8)


def save_png(path: Path, pixels: ndarray) -> None:
    """Write a PNG atomically; folders are made. Raises DataError where it cannot be written."""
    with open_atomically(path) as file:
        Image.fromarray(pixels).save(file, format="PNG")
