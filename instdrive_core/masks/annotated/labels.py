"""Dense instance labels of real photos from what annotators gave: cuboids, semantic classes of LiDAR points.

The labelled cloud of the whole clip is drawn into each photo, tracked objects as whole silhouettes; borders between
labels and pixels without a point are then settled by the photo's edges.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.labelled_cloud import UNKNOWN, build_cloud
from instdrive_core.masks.annotated.silhouettes import draw_objects
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance
from instdrive_core.masks.image.point_drawing import draw_points
from instdrive_core.masks.image.sky import SkyColors, find_certain_sky, find_sky_seeds
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
WIDE_REACH, REACH, SKY_REACH = 0.12, 0.0125, 0.25
"""Distances, as shares of the image's width, up to which wide surfaces, anything else, and the sky spread."""


def has_annotations(clip: Clip) -> bool:
    """Whether a clip has what these labels are made of."""
    return bool(clip.sweeps) and (bool(clip.tracks) or bool(clip.class_names))


class AnnotationLabels:
    """Labels of a clip made from its annotations; IDs hold in all frames and cameras.

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
        self._cloud = build_cloud(clip, held_out)
        self._sky = 1 + max(self.instances, default=0)
        self._things = range(min(self._cloud.tracks, default=self._sky), self._sky)
        self._sky_colors = self._learn_colors(clip)
        self._last: tuple[str, Int32[ndarray, "h w"]] | None = None

    @property
    def instances(self) -> dict[int, GroundTruthInstance]:
        """Facts of each ID."""
        return self._cloud.instances

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load IDs at the frame's size; 0 = unknown, sky or ego vehicle."""
        labels = self._load_labels(frame)
        kept = (labels > UNKNOWN) & (labels != self._sky)
        if frame.valid is not None:
            kept &= frame.valid
        return np.where(kept, labels, 0).astype(np.uint32)

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        return self._load_labels(frame) == self._sky

    def _load_labels(self, frame: Frame) -> Int32[ndarray, "h w"]:
        """Labels with the sky as one of them; -1 where nothing is known. The last frame's are kept."""
        if self._last is None or self._last[0] != frame.key:
            self._last = (frame.key, self._make_labels(frame))
        return self._last[1]

    def _make_labels(self, frame: Frame) -> Int32[ndarray, "h w"]:
        image, camera = frame.load_image(), frame.view.camera
        labels = self._draw(frame)
        things = ndimage.binary_dilation(labels >= self._things.start, iterations=THING_REACH)
        labels[find_sky_seeds(labels != OPEN, image, camera, self._sky_colors)] = self._sky
        opened = open_borders(labels, BORDER)
        filled = spread_labels(opened, image, self._compute_limits(camera.width), things, self._things)
        seams = np.full(self._sky + 1, SEAM, np.float32)
        return spread_labels(filled, np.zeros_like(image), seams, things, self._things)

    def _draw(self, frame: Frame) -> Int32[ndarray, "h w"]:
        """IDs where points were drawn, else OPEN."""
        drawn, depths = draw_points(self._cloud.points, self._cloud.ids, frame.view.camera, POINT_SIZE)
        draw_objects(self._cloud, frame.view, drawn, depths)
        return np.where(np.isfinite(depths), drawn.astype(np.int32), OPEN)

    def _learn_colors(self, clip: Clip) -> SkyColors:
        """Learn what sky and surfaces look like in a few steps of the clip."""
        colors = SkyColors()
        steps = sorted({frame.view.index for frame in clip.training_frames})
        chosen = {steps[position] for position in (0, len(steps) // 2, -1)} if steps else set()
        for frame in clip.training_frames:
            if frame.view.index in chosen:
                image, surface = frame.load_image(), self._draw(frame) != OPEN
                colors.add(image, find_certain_sky(surface, image, frame.view.camera), surface)
        return colors

    def _compute_limits(self, width: int) -> Float32[ndarray, " l"]:
        limits = np.full(self._sky + 1, REACH, np.float32)
        limits[[number for number, one in self.instances.items() if one.class_name in WIDE_SURFACES]] = WIDE_REACH
        limits[self._sky] = SKY_REACH
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
