"""Masks that need no weights and no annotations: clusters of LiDAR points, given borders by the photo.

Only points, times, camera poses and photos are used, of training time steps alone.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.labels import OPEN, open_borders
from instdrive_core.masks.annotated.stuff_regions import merge_into_regions
from instdrive_core.masks.image.beams import estimate_sensor_position
from instdrive_core.masks.image.point_drawing import draw_points
from instdrive_core.masks.image.sky import find_sky_gaps
from instdrive_core.masks.image.sky_search import SkySearch
from instdrive_core.masks.image.spreading import spread_labels
from instdrive_core.masks.lidar.cluster_kind import BACKDROP, FACADE, GROUND, THING, VEGETATION, WALL
from instdrive_core.masks.lidar.regions import draw_things, fill_label_holes, vote_by_superpixel
from instdrive_core.masks.lidar.scene import LidarScene, build_lidar_scene
from instdrive_core.masks.lidar.stuff_pixels import count_stuff_pixels
from instdrive_core.scene.camera import Camera

POINT_SIZE = 0.15
"""Metres that a point of the static cloud stands for."""
BORDER = 1
"""Pixels on either side of a border that are settled by the photo."""
THING_REACH = 2
"""Pixels by which a thing may grow beyond its silhouette."""
MIN_PIXELS = 40
"""Smaller masks are left out."""
SEAM = 2.0
"""Pixels: gaps this wide along edges too strong to spread into are closed without looking at the photo."""
REACHES = {GROUND: 0.12, FACADE: 0.06, WALL: 0.06, VEGETATION: 0.03, BACKDROP: 0.03}
REACH = 0.0125
"""Distances, as shares of the image's width, up to which wide surfaces, and things and the sky spread."""
REGION_PHOTOS = 40
"""Photos, evenly over the drive and the cameras, that say which facades, walls and plants hang together."""


class LidarLabels:
    """Labels of a clip made from bare LiDAR points; static things keep theirs in all frames, moving ones do not.

    Args:
        clip: the clip.

    Raises DataError where the clip has no LiDAR that may be used.
    """

    source = "lidar"

    def __init__(self, clip: Clip) -> None:
        if not clip.training_sweeps:
            remedy = "Choose another source of masks; `instdrive masks --help` lists them"
            raise DataError(clip.path, "has no LiDAR sweeps to make masks of", remedy)
        path = np.array([estimate_sensor_position(clip, sweep.time) for sweep in clip.training_sweeps])
        self._scene: LidarScene = build_lidar_scene(clip, posts_apart=False).part_ground(path)
        self._things = self._scene.group_things()
        self._sky_search = SkySearch(clip, lambda frame: self._draw(frame.view.camera, frame.view.time)[0] != OPEN)
        self._regions = self._find_regions(clip)
        self._last: tuple[str, Int32[ndarray, "h w"], Bool[ndarray, "h w"]] | None = None

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load a number per mask at the frame's size; 0 = none, sky or ego vehicle."""
        labels, sky = self._load_labels(frame)
        kept = (labels != OPEN) & ~sky
        if frame.valid is not None:
            kept &= frame.valid
        found = np.where(kept, labels, 0).astype(np.uint32)
        return np.where(np.bincount(found.ravel())[found] < MIN_PIXELS, 0, found).astype(np.uint32)

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        return self._load_labels(frame)[1]

    def _find_regions(self, clip: Clip) -> Int64[ndarray, " i"]:
        """Find the ID that stands for each facade, wall and plant: those that photos show as one are one."""
        frames = clip.training_frames
        chosen = np.unique(np.linspace(0, len(frames) - 1, REGION_PHOTOS).astype(int)) if frames else []
        wide = self._scene.kinds[: self._scene.first_thing]
        photos = [count_stuff_pixels(self._make_labels(frames[number])[0], wide) for number in chosen]
        return merge_into_regions(photos, wide)

    def _load_labels(self, frame: Frame) -> tuple[Int32[ndarray, "h w"], Bool[ndarray, "h w"]]:
        """Labels, `OPEN` where nothing is known, and the sky. The last frame's are kept."""
        if self._last is None or self._last[0] != frame.key:
            labels, sky = self._make_labels(frame)
            wide = (labels != OPEN) & (labels < len(self._regions))
            labels[wide] = self._regions[labels[wide]]
            self._last = frame.key, labels, sky
        return self._last[1], self._last[2]

    def _make_labels(self, frame: Frame) -> tuple[Int32[ndarray, "h w"], Bool[ndarray, "h w"]]:
        image, camera = frame.load_image(), frame.view.camera
        drawn, depths = self._draw(camera, frame.view.time)
        seeds, originals = _compact_labels(drawn)
        sky = len(originals)
        floors = range(*(int(np.searchsorted(originals, end)) for end in (GROUND, self._scene.first_standing)))
        things = range(int(np.searchsorted(originals, self._scene.first_thing)), sky)
        reachable = np.asarray(ndimage.binary_dilation(seeds >= things.start, iterations=THING_REACH))
        seeds[self._sky_search.find_seeds(seeds != OPEN, image, camera)] = sky
        voted = vote_by_superpixel(open_borders(seeds, BORDER), image, reachable, things)
        limits = self._compute_limits(originals, camera.width)
        filled = spread_labels(voted, image, limits, reachable, things)
        filled = spread_labels(filled, np.zeros_like(image), np.full(sky + 1, SEAM, np.float32), reachable, things)
        filled[find_sky_gaps(filled == OPEN, filled == sky, camera)] = sky
        filled = fill_label_holes(filled, depths, floors, things)
        back = np.append(originals, 0).astype(np.int32)
        return np.where(filled == OPEN, OPEN, back[filled]), filled == sky

    def _draw(self, camera: Camera, time: float) -> tuple[Int32[ndarray, "h w"], Float32[ndarray, "h w"]]:
        """IDs where points were drawn, else `OPEN`, and depths."""
        wide = self._scene.ids < self._scene.first_thing
        labels, depths = draw_points(self._scene.points[wide], self._scene.ids[wide], camera, POINT_SIZE)
        draw_things(self._things | self._scene.place_moving(time, camera.lag), camera, labels, depths)
        return np.where(np.isfinite(depths) & (labels > 0), labels.astype(np.int32), OPEN), depths

    def _compute_limits(self, originals: Int32[ndarray, " l"], width: int) -> Float32[ndarray, " l+1"]:
        kinds = np.append(self._scene.kinds, THING)[np.minimum(originals, len(self._scene.kinds))]
        shares = [REACHES.get(kind, REACH) for kind in kinds.tolist()] + [REACH]
        return np.array(shares, np.float32) * np.float32(width)


def _compact_labels(labels: Int32[ndarray, "h w"]) -> tuple[Int32[ndarray, "h w"], Int32[ndarray, " l"]]:
    """Labels counted from 0, `OPEN` kept, and what they were; in order."""
    originals = np.unique(labels[labels != OPEN])
    return np.where(labels == OPEN, OPEN, np.searchsorted(originals, labels)).astype(np.int32), originals
