"""ID maps in COCO's panoptic format (cocodataset.org/#format-data): pictures of segments and one JSON file.

Layout::

    panoptic/<camera>_NN.png   R + 256 G + 65536 B is the segment's ID, which is the instance's; black is nothing
    panoptic.json              images, categories, and every picture's segments; written last
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.files.atomic import write_bytes
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.masks.annotated.labelled_cloud import NO_SURFACE, ONE_SURFACE
from instdrive_core.masks.annotated.labels import WIDE_SURFACES
from instdrive_core.masks.export.id_maps import IdMap
from instdrive_core.masks.export.id_pictures import pack_ids, remove_listing, save_png
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene

LISTING, PICTURES = "panoptic.json", "panoptic"
UNNAMED = "object"
"""The category of instances whose class is not known."""
STUFF = WIDE_SURFACES | NO_SURFACE | frozenset(ONE_SURFACE) | {"Vegetation"}
"""Classes that are no things, by their names in driving data sets."""


def write_coco_panoptic(
    folder: Path, scene: Scene, maps: Iterable[IdMap], on_view: Callable[[int], None] = lambda done: None
) -> int:
    """Write the pictures of all maps, each atomically, and the JSON at the end; returns how many.

    Raises DataError where the folder cannot be written.
    """
    remove_listing(folder / LISTING)
    class_of = {instance.id: instance.class_name or UNNAMED for instance in scene.table}
    names = sorted({UNNAMED, *class_of.values()})
    category = {name: number for number, name in enumerate(names, start=1)}
    images, annotations = [], []
    for found in maps:
        number = len(images) + 1
        picture = f"{found.view.name}_{found.view.index:02d}.png"
        save_png(folder / PICTURES / picture, pack_ids(found.ids))
        images.append(_describe_image(number, found))
        segments = [
            {**segment, "category_id": category[class_of.get(segment["id"], UNNAMED)], "iscrowd": 0}
            for segment in measure_segments(found.ids)
        ]
        annotations.append({"image_id": number, "file_name": picture, "segments_info": segments})
        on_view(number)
    content = {
        "info": {"description": "instances of an InstDrive scene", "version": "1.0"},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": [_describe_category(number, name) for name, number in category.items()],
    }
    write_bytes(folder / LISTING, (json.dumps(content, ensure_ascii=False) + "\n").encode())
    return len(images)


def measure_segments(ids: UInt32[ndarray, "h w"]) -> list[dict[str, Any]]:
    """Measure ID, area (pixels) and bounding box (x, y, width, height) of every instance of a map, in the order of
    IDs."""
    present, positions = np.unique(ids, return_inverse=True)
    positions = positions.reshape(ids.shape)
    areas = np.bincount(positions.ravel(), minlength=len(present))
    # find_objects counts from 1.
    boxes = ndimage.find_objects(positions + 1)
    return [
        {
            "id": instance_id,
            "area": area,
            "bbox": [columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start],
        }
        for instance_id, area, (rows, columns) in zip(present.tolist(), areas.tolist(), boxes, strict=True)
        if instance_id
    ]


def _describe_image(number: int, found: IdMap) -> dict[str, Any]:
    view = found.view
    height, width = found.ids.shape
    return {
        "id": number,
        "file_name": _name_photo(view),
        "width": width,
        "height": height,
        "camera": view.name,
        "step": view.index,
        "time": view.time,
        "held_out": view.held_out,
    }


def _name_photo(view: CameraView) -> str:
    """Below the folder of all photos: with the camera's own folder, where it has one."""
    photo = Path(view.photo) if view.photo else Path(view.name) / f"{view.index:02d}.png"
    return f"{view.name}/{photo.name}" if photo.parent.name == view.name else photo.name


def _describe_category(number: int, name: str) -> dict[str, Any]:
    is_thing = name not in STUFF
    return {
        "id": number,
        "name": name,
        "supercategory": "thing" if is_thing else "stuff",
        "isthing": int(is_thing),
        "color": colors_from_ids(np.array(number, np.uint32)).tolist(),
    }
