"""COCO files of a recording (cocodataset.org/#format-data): instances with run-length masks, and panoptic pictures.

Layout::

    images/<camera>/NN.png      colours
    instances.json              a box and a mask per visible thing; 'amodal_bbox', 'visibility' and 'instance_id' beside
    panoptic/<camera>_NN.png    R + 256 G + 65536 B is the segment's ID, which is the editor's instance
    panoptic.json
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.datasets.layout_files import require_new_folder, write_layout_file
from instdrive_core.files.json_fields import read_json
from instdrive_core.masks.export.coco_panoptic import UNNAMED, measure_segments
from instdrive_core.masks.export.id_pictures import pack_ids, save_png
from instdrive_core.progress import report
from instdrive_core.recording.folder import read_id_map, read_manifest

INSTANCES, PANOPTIC = "instances.json", "panoptic.json"


def write_coco(folder: Path, out: Path) -> Path:
    """Write a finished recording as a data set of COCO; returns its folder.

    Instances are things only, panoptic segments are all instances; both have the editor's IDs (`instance_id`, and the
    segments' own `id`). Raises DataError where the recording is unfinished or the folder is not empty.
    """
    require_new_folder(out)
    manifest = read_manifest(folder)
    facts = {entry["id"]: entry for entry in manifest["instances"]}
    categories = _list_categories(manifest)
    number_of = {category["name"]: category["id"] for category in categories}
    images, annotations, panoptic = [], [], []
    for place, entry in enumerate(manifest["views"]):
        report(place / len(manifest["views"]))
        image = _describe_image(place + 1, entry)
        images.append(image)
        target = out / "images" / image["file_name"]
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / entry["color"], target)
        ids = read_id_map(folder / entry["color"].replace("color/", "instances/", 1))
        seen = {one["id"]: one for one in read_json(folder / entry["file"])["objects"]}
        segments = measure_segments(ids)
        for segment in segments:
            segment |= {"category_id": number_of[facts[segment["id"]]["class"] or UNNAMED], "iscrowd": 0}
            if facts[segment["id"]]["is_thing"]:
                mask = ids == segment["id"]
                annotations.append(_describe_instance(len(annotations) + 1, image, segment, mask, seen))
        name = f"{entry['camera']}_{entry['step']:02d}.png"
        save_png(out / "panoptic" / name, pack_ids(ids))
        panoptic.append({"image_id": image["id"], "file_name": name, "segments_info": segments})
    things = [category for category in categories if category["isthing"]]
    _write(out / INSTANCES, images, annotations, things)
    _write(out / PANOPTIC, images, panoptic, categories)
    return out


def encode_run_lengths(mask: Bool[ndarray, "h w"]) -> dict[str, Any]:
    """Encode a mask as COCO's uncompressed run lengths: columns first, the first run is of zeros."""
    flat = mask.ravel(order="F")
    edges = np.flatnonzero(np.diff(flat)) + 1
    counts = np.diff(np.concatenate([[0], edges, [len(flat)]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *counts] if flat[0] else counts}


def _list_categories(manifest: dict[str, Any]) -> list[dict[str, Any]]:
    """Classes by name; a class is a thing where any of its instances is one."""
    things = {entry["class"] or UNNAMED for entry in manifest["instances"] if entry["is_thing"]}
    names = sorted({UNNAMED, *(entry["name"] for entry in manifest["classes"])})
    listed = []
    for number, name in enumerate(names, start=1):
        is_thing = name in things or name == UNNAMED
        listed.append(
            {"id": number, "name": name, "supercategory": "thing" if is_thing else "stuff", "isthing": int(is_thing)}
        )
    return listed


def _describe_image(number: int, entry: dict[str, Any]) -> dict[str, Any]:
    return {
        "id": number,
        "file_name": f"{entry['camera']}/{entry['step']:02d}.png",
        "width": entry["width"],
        "height": entry["height"],
        "camera": entry["camera"],
        "step": entry["step"],
        "time": entry["time"],
    }


def _describe_instance(
    number: int,
    image: dict[str, Any],
    segment: dict[str, Any],
    mask: Bool[ndarray, "h w"],
    seen: dict[int, dict[str, Any]],
) -> dict[str, Any]:
    known = seen.get(segment["id"], {})
    return {
        "id": number,
        "image_id": image["id"],
        "category_id": segment["category_id"],
        "bbox": segment["bbox"],
        "area": segment["area"],
        "iscrowd": 0,
        "segmentation": encode_run_lengths(mask),
        "instance_id": segment["id"],
        "amodal_bbox": known.get("box_amodal"),
        "visibility": known.get("visibility"),
    }


def _write(
    path: Path, images: list[dict[str, Any]], annotations: list[dict[str, Any]], categories: list[dict[str, Any]]
) -> None:
    content = {
        "info": {"description": "recorded from an edited InstDrive scene", "version": "1.0"},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": categories,
    }
    write_layout_file(path, json.dumps(content, ensure_ascii=False).encode())
