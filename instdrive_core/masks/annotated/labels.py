"""Dense instance labels of real photos from what annotators gave: cuboids, semantic classes of LiDAR points.

The labelled cloud of the whole clip is drawn into each photo, tracked objects as whole silhouettes; borders between
labels and pixels without a point are then settled by the photo's edges.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int32, Integer, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.labelled_cloud import UNKNOWN, build_cloud
from instdrive_core.masks.annotated.part_maps import PartMap, PartPixels, build_part_map
from instdrive_core.masks.annotated.silhouettes import draw_objects
from instdrive_core.masks.annotated.stuff_parts import split_stuff
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance
from instdrive_core.masks.image.point_drawing import draw_points
from instdrive_core.masks.image.sky import find_sky_gaps
from instdrive_core.masks.image.sky_search import SkySearch
from instdrive_core.masks.image.spreading import spread_labels

POINT_SIZE = 0.1
"""Metres that a point of the static cloud stands for."""
OPEN = -1
BORDER = 1
"""Pixels on either side of a border that are settled by the photo."""
SEAM = 2.0
"""Pixels: gaps this wide along edges too strong to spread into are closed without looking at the photo."""
THING_REACH = 2
"""Pixels by which a thing may grow beyond its silhouette."""
WIDE_SURFACES = frozenset(("Building", "Driveway", "Ground", "Road", "Sidewalk"))
WIDE_REACH, REACH = 0.12, 0.0125
"""Distances, as shares of the image's width, up to which wide surfaces and anything else spread."""


def has_annotations(clip: Clip) -> bool:
    """Whether a clip has what these labels are made of."""
    return bool(clip.sweeps) and (bool(clip.tracks) or bool(clip.class_names))


@dataclass(frozen=True)
class _FrameLabels:
    labels: Int32[ndarray, "h w"]
    """Stuff by class; the sky is one of the labels, -1 is unknown."""
    parts: PartMap


class AnnotationLabels:
    """Labels of a clip made from its annotations. A thing has one ID in all frames and cameras.

    Stuff of one class has an ID for each region of the photo that hangs together, in the photo or in space. Its ID is
    that of its least part there; only `AnnotatedTruth` says which regions of several photos are one.

    Args:
        clip: the clip.
        held_out: whether sweeps of held-out time steps may be used: True to evaluate, False for what trains.

    Raises DataError where the clip has no annotations.
    """

    source = "annotations"

    def __init__(self, clip: Clip, held_out: bool) -> None:
        if not has_annotations(clip):
            problem = "has no annotations: LiDAR with cuboids or semantic classes is needed"
            raise DataError(clip.path, problem, "Choose another source of masks; `instdrive masks --help` lists them")
        self.cloud = build_cloud(clip, held_out)
        self.stuff = split_stuff(self.cloud.points, self.cloud.ids)
        self._sky = 1 + max(self.cloud.instances, default=0)
        self._things = range(min(self.cloud.tracks, default=self._sky), self._sky)
        self.first_thing = len(self.stuff.label_of_part)
        """ID of the first thing; stuff has lower ones, those of its parts."""
        self._sky_search = SkySearch(clip, lambda frame: self._draw(frame)[0] != OPEN)
        self._last: tuple[str, _FrameLabels] | None = None

    @property
    def instances(self) -> dict[int, GroundTruthInstance]:
        """Facts of each ID."""
        labels = enumerate(self.stuff.label_of_part.tolist())
        return self.list_regions([(part, (part,)) for part, label in labels if label != UNKNOWN])

    def list_regions(self, regions: Iterable[tuple[int, tuple[int, ...]]]) -> dict[int, GroundTruthInstance]:
        """List the facts of regions of stuff, each with the parts it consists of, and of all things.

        Regions of a class are named by size, the largest first.
        """
        sizes = np.bincount(self.stuff.parts, minlength=self.first_thing)
        counted, facts = Counter[str](), {}
        for number, parts in sorted(regions, key=lambda region: -int(sizes[list(region[1])].sum())):
            name = self.cloud.instances[int(self.stuff.label_of_part[parts[0]])].class_name
            counted[name] += 1
            facts[number] = GroundTruthInstance(number, f"{name} {counted[name]}", name, "stuff")
        for label in self._things:
            number = label - self._things.start + self.first_thing
            facts[number] = replace(self.cloud.instances[label], id=number)
        return dict(sorted(facts.items()))

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load IDs at the frame's size; 0 = unknown, sky or ego vehicle."""
        labels = self._load_labels(frame)
        regions = labels.parts.join_regions(self.first_thing).astype(np.uint32)
        return self._show(frame, labels.labels, regions[labels.parts.parts])

    def load_parts(self, frame: Frame) -> tuple[UInt32[ndarray, "h w"], PartPixels]:
        """Load IDs with every part of stuff for itself, and the pixels of each in each region of the photo."""
        labels = self._load_labels(frame)
        return self._show(frame, labels.labels, labels.parts.parts), labels.parts.counts

    def draw_parts(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Draw IDs with every part of stuff for itself where LiDAR points or the silhouettes of things lie, else 0.

        Nothing is spread from there: quick, and enough to vote with.
        """
        labels, parts = self._draw(frame)
        return self._show(frame, labels, np.where(self.stuff.label_of_part[parts] == labels, parts, 0))

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        return self._load_labels(frame).labels == self._sky

    def _show(
        self, frame: Frame, labels: Int32[ndarray, "h w"], stuff: Integer[ndarray, "h w"]
    ) -> UInt32[ndarray, "h w"]:
        """IDs of things by label, of other pixels those of `stuff`; 0 on sky, ego vehicle and what is unknown."""
        is_thing = (labels >= self._things.start) & (labels != self._sky)
        shown = np.where(is_thing, labels - self._things.start + self.first_thing, stuff)
        kept = (labels > UNKNOWN) & (labels != self._sky)
        if frame.valid is not None:
            kept &= frame.valid
        return np.where(kept, shown, 0).astype(np.uint32)

    def _load_labels(self, frame: Frame) -> _FrameLabels:
        """Labels with the sky as one of them; -1 where nothing is known. The last frame's are kept."""
        if self._last is None or self._last[0] != frame.key:
            self._last = (frame.key, self._make_labels(frame))
        return self._last[1]

    def _make_labels(self, frame: Frame) -> _FrameLabels:
        image, camera = frame.load_image(), frame.view.camera
        labels, parts = self._draw(frame)
        things = ndimage.binary_dilation(labels >= self._things.start, iterations=THING_REACH)
        labels[self._sky_search.find_seeds(labels != OPEN, image, camera)] = self._sky
        opened = open_borders(labels, BORDER)
        filled = spread_labels(opened, image, self._compute_limits(camera.width), things, self._things)
        seams = np.full(self._sky + 1, SEAM, np.float32)
        closed = spread_labels(filled, np.zeros_like(image), seams, things, self._things)
        closed[find_sky_gaps(closed == OPEN, closed == self._sky, camera)] = self._sky
        return _FrameLabels(closed, build_part_map(closed, parts, self.stuff.label_of_part))

    def _draw(self, frame: Frame) -> tuple[Int32[ndarray, "h w"], UInt32[ndarray, "h w"]]:
        """Labels where points were drawn, else OPEN; the parts of stuff that were drawn."""
        parts, depths = draw_points(self.cloud.points, self.stuff.parts, frame.view.camera, POINT_SIZE)
        drawn = self.stuff.label_of_part[parts]
        draw_objects(self.cloud, frame.view, drawn, depths)
        return np.where(np.isfinite(depths), drawn.astype(np.int32), OPEN), parts

    def _compute_limits(self, width: int) -> Float32[ndarray, " l"]:
        limits = np.full(self._sky + 1, REACH, np.float32)
        if self._things.start == UNKNOWN + 1:  # no classes: streets and houses are among what nobody named
            limits[UNKNOWN] = WIDE_REACH
        limits[[number for number, one in self.cloud.instances.items() if one.class_name in WIDE_SURFACES]] = WIDE_REACH
        return limits * np.float32(width)


def open_borders(labels: Int32[ndarray, "h w"], width: int) -> Int32[ndarray, "h w"]:
    """Open pixels within `width` of another label, except where little of a label would be left."""
    low = ndimage.minimum_filter(np.where(labels == OPEN, np.iinfo(np.int32).max, labels), 2 * width + 1)
    high = ndimage.maximum_filter(labels, 2 * width + 1)
    border = (labels != OPEN) & (low != high)
    size = int(labels.max(initial=0)) + 1
    before = np.bincount(labels[labels != OPEN], minlength=size)
    inner = np.bincount(labels[(labels != OPEN) & ~border], minlength=size)
    keep_whole = inner < 0.4 * before
    return np.where(border & ~keep_whole[np.maximum(labels, 0)], OPEN, labels)
