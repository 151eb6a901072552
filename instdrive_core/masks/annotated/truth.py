"""Ground truth made from annotations: one object per thing, and one per region of stuff."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, UInt8, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.annotated.labelled_cloud import NOTHING, UNKNOWN, assign_class_ids
from instdrive_core.masks.annotated.labels import AnnotationLabels
from instdrive_core.masks.annotated.stuff_regions import merge_into_regions
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance


@dataclass(frozen=True)
class _Known:
    regions: UInt32[ndarray, " ids"]
    """Region of each part of stuff; things stand for themselves."""
    maps: dict[str, tuple[UInt32[ndarray, "h w"], Bool[ndarray, "h w"]]]
    """IDs by part, and the sky, of each held-out photo by its key."""


class AnnotatedTruth:
    """Objects that people annotated, as held-out photos and sweeps show them; IDs hold everywhere.

    Data sets give stuff a class and no instance: PandaSet has one *building* for both sides of a street. Here each
    connected region of a label map is an object, and LiDAR points say which regions of several photos are the same.

    Raises DataError where the clip has no annotations.
    """

    source = "annotations"

    def __init__(self, clip: Clip) -> None:
        self.labels = AnnotationLabels(clip, held_out=True)
        self._frames = clip.held_out_frames
        stuff = (fact for fact in self.labels.cloud.instances.values() if fact.kind == "stuff")
        self._label_of_class = assign_class_ids(clip.class_names, {fact.class_name: fact.id for fact in stuff})
        self._label_of_class[self._label_of_class == NOTHING] = UNKNOWN

    @cached_property
    def instances(self) -> dict[int, GroundTruthInstance]:
        """Facts of each ID."""
        members: dict[int, list[int]] = {}
        for part in np.flatnonzero(self.labels.stuff.label_of_part != UNKNOWN).tolist():
            members.setdefault(int(self._known.regions[part]), []).append(part)
        return self.labels.list_regions((region, tuple(parts)) for region, parts in members.items())

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load IDs at the frame's size; 0 = unknown, sky or ego vehicle."""
        kept = self._known.maps.get(frame.key)
        return self._known.regions[self.labels.load_parts(frame)[0] if kept is None else kept[0]]

    def draw(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Draw the IDs of LiDAR points, and of things as whole silhouettes, into a photo; 0 elsewhere."""
        return self._known.regions[self.labels.draw_parts(frame)]

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        kept = self._known.maps.get(frame.key)
        return self.labels.load_sky(frame) if kept is None else kept[1]

    def find_stuff(self, points: Float32[ndarray, "n 3"], classes: UInt8[ndarray, " n"]) -> UInt32[ndarray, " n"]:
        """Find the region of stuff that LiDAR points (world, metres) with semantic classes lie on; 0 = none."""
        return self._known.regions[self.labels.stuff.find_parts(points, self._label_of_class[classes])]

    @cached_property
    def _known(self) -> _Known:
        maps, counts = {}, []
        for frame in self._frames:
            ids, pixels = self.labels.load_parts(frame)
            maps[frame.key] = ids, self.labels.load_sky(frame)
            counts.append(pixels)
        regions = np.arange(1 + max(self.labels.instances, default=0), dtype=np.uint32)
        regions[: self.labels.first_thing] = merge_into_regions(counts, self.labels.stuff.label_of_part)
        return _Known(regions, maps)
