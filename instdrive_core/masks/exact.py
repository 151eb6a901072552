"""Exact instance labels, as synthetic clips keep them beside their photos.

Layout: ``labels/<camera>/NN.png`` (16-bit instance, 0 = none), ``labels/sky/<camera>/NN.png`` (255 = sky) and
``labels/instances.json`` (instance → class, kind, moving, uuid).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Frame
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import parse_whole_number, read_json, require_field
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance
from instdrive_core.masks.label_map_folder import read_label_map, read_sky_mask, resample_nearest

_REMEDY = "Write the synthetic clip again with `instdrive synth`, or choose another source of masks"


def has_exact_labels(clip_path: str | Path) -> bool:
    """Whether the clip keeps exact labels."""
    return (Path(clip_path) / "labels" / "instances.json").is_file()


class ExactLabels:
    """The labels of a synthetic clip. Raises DataError where the clip has none or a file of them is damaged."""

    source = "exact"

    def __init__(self, clip_path: str | Path) -> None:
        self.folder = Path(clip_path) / "labels"
        if not has_exact_labels(clip_path):
            problem = "has no exact labels: 'labels/instances.json' is missing"
            raise DataError(clip_path, problem, "Only synthetic clips have them; choose another source of masks")
        self.instances = _read_instances(self.folder / "instances.json")

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load instances at the frame's size; 0 = none, also on the ego vehicle."""
        file = self.folder / f"{frame.key}.png"
        labels = read_label_map(file)
        unknown = set(np.unique(labels).tolist()) - {0} - set(self.instances)
        if unknown:
            raise DataError(file, f"holds the instance {min(unknown)}, which instances.json does not list", _REMEDY)
        sized = resample_nearest(labels, frame.view.camera.width, frame.view.camera.height).astype(np.uint32)
        return sized if frame.valid is None else np.where(frame.valid, sized, np.uint32(0))

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        sky = read_sky_mask(self.folder / "sky" / f"{frame.key}.png")
        return resample_nearest(sky, frame.view.camera.width, frame.view.camera.height)


def _read_instances(file: Path) -> dict[int, GroundTruthInstance]:
    entries = read_json(file)
    if isinstance(entries, dict) and "instances" in entries:
        entries = entries["instances"]
    if not isinstance(entries, dict):
        raise DataError(file, "expected an object from instance numbers to their facts", _REMEDY)
    instances = {}
    for key, entry in entries.items():
        number = _parse_instance_number(file, key)
        kind = require_field(file, entry, "kind", f"{key}.")
        if kind not in ("thing", "stuff"):
            raise DataError(file, f"the field '{key}.kind' is {kind!r}, expected 'thing' or 'stuff'", _REMEDY)
        class_name, uuid = str(require_field(file, entry, "class", f"{key}.")), entry.get("uuid")
        instances[number] = GroundTruthInstance(
            id=number,
            name=str(entry.get("name", f"{class_name} {key}")),
            class_name=class_name,
            kind=kind,
            moving=bool(entry.get("moving", False)),
            track_id=None if uuid is None else str(uuid),
        )
    return instances


def _parse_instance_number(file: Path, key: str) -> int:
    try:
        number = parse_whole_number(key)
    except ValueError as error:
        problem = f"expected an object from instance numbers to their facts, but {error}"
        raise DataError(file, problem, _REMEDY) from error
    if not number:
        raise DataError(file, "lists the instance 0, which stands for none", _REMEDY)
    return number
