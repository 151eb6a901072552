"""Finds what moves in a clip's photos, given masks, and keeps it out of what trains."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int8, Int32, Int64, UInt8
from numpy import ndarray
from scipy.ndimage import binary_dilation

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.label_map_folder import MaskFolder
from instdrive_core.scene.seen_moving import SeenMover, Sighting
from instdrive_core.tracks.photos.feature_paths import FeaturePaths, drop_last_places, follow_corners
from instdrive_core.tracks.photos.grouping import group_strands
from instdrive_core.tracks.photos.layers import ShownThing, join_overlapping
from instdrive_core.tracks.photos.overlap import follow_by_overlap
from instdrive_core.tracks.photos.path_verdicts import SHORTEST, CameraPaths, judge_paths
from instdrive_core.tracks.photos.region_votes import (
    RegionLinks,
    find_moving_strands,
    find_standing_strands,
    link_regions,
)
from instdrive_core.wording import format_count

MARGIN = 3
"""Pixels around a moving mask that are kept out as well: masks end a little early, and edges are blurred."""

_LEAST_DIP = 0.017
"""Sine of the angle below the horizon at which what moves meets the ground: 1°, some 90 m away for a car's camera."""


@dataclass(frozen=True)
class FoundInPhotos:
    """What moves in a clip's photos."""

    movers: tuple[SeenMover, ...]
    pixels: dict[str, Bool[ndarray, "_ _"]]
    """By frame key: pixels that show something moving, a margin around it included; photos without any are missing."""


def find_seen_movers(
    clip: Clip, masks: MaskFolder, on_stage: Callable[[str], None] = lambda stage: None
) -> FoundInPhotos:
    """Find the masks of training photos that move. Nothing of held-out time steps is looked at.

    Args:
        clip: the clip; only photos and camera poses are used.
        masks: masks of all of its training photos.
        on_stage: is told what is being done.

    Raises DataError where a photo or a mask is damaged, ModuleNotFoundError where OpenCV is not installed.
    """
    by_camera = [[frame for frame in clip.training_frames if frame.view.name == name] for name in clip.camera_names]
    by_camera = [frames for frames in by_camera if len(frames) >= SHORTEST]
    on_stage("following corners through photos")
    followed = [_follow(frames, masks) for frames in by_camera]
    on_stage("asking what stands")
    rig = [
        CameraPaths([frame.view.camera for frame in frames], drop_last_places(paths))
        for frames, paths in zip(by_camera, followed, strict=True)
    ]
    verdicts = judge_paths(rig)
    movers: list[SeenMover] = []
    pixels: dict[str, Bool[ndarray, "_ _"]] = {}
    for frames, paths, said in zip(by_camera, followed, verdicts, strict=True):
        layers = zip(*(_load_layers(masks, frame) for frame in frames), strict=True)
        shown = [thing for maps in layers for thing in _find_in_layer(paths, said, maps)]
        for thing in join_overlapping(shown):
            mover = _describe(thing, frames)
            if _stands_on_ground(mover, frames):
                movers.append(mover)
                for photo, inside in thing.items():
                    key = frames[photo].key
                    pixels[key] = pixels[key] | inside if key in pixels else inside
    movers.sort(key=lambda mover: (mover.sightings[0].step, -len(mover.sightings), mover.camera))
    grown = {key: binary_dilation(inside, iterations=MARGIN) for key, inside in pixels.items()}
    return FoundInPhotos(tuple(movers), grown)


def keep_out_movers(clip: Clip, found: FoundInPhotos) -> Clip:
    """Keep the pixels that show something moving out of all that photos teach."""
    return replace(clip, frames=tuple(_without_movers(frame, found.pixels.get(frame.key)) for frame in clip.frames))


def summarize_movers(movers: Sequence[SeenMover]) -> str:
    """Say what is seen moving, and by which cameras."""
    cameras = list(dict.fromkeys(mover.camera for mover in movers))
    photos = len({(mover.camera, sighting.step) for mover in movers for sighting in mover.sightings})
    return (
        f"{format_count(len(movers), 'thing')} seen moving, not rebuilt: left out of "
        f"{format_count(photos, 'photo')} of {', '.join(cameras)}"
    )


def _without_movers(frame: Frame, moving: Bool[ndarray, "h w"] | None) -> Frame:
    if moving is None:
        return frame
    return replace(frame, valid=~moving if frame.valid is None else frame.valid & ~moving)


def _follow(frames: Sequence[Frame], masks: MaskFolder) -> FeaturePaths:
    def look() -> Iterator[tuple[UInt8[ndarray, "h w"], Bool[ndarray, "h w"]]]:
        for frame in frames:
            usable = ~masks.load(frame).sky
            yield _to_grey(frame.load_image()), usable if frame.valid is None else usable & frame.valid

    return follow_corners(look())


def _to_grey(image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w"]:
    """Luma (ITU-R BT.601)."""
    return np.round(image @ np.array([0.299, 0.587, 0.114], np.float32)).astype(np.uint8)


def _load_layers(masks: MaskFolder, frame: Frame) -> list[Int32[ndarray, "_ _"]]:
    loaded = masks.load(frame)
    return [labels.astype(np.int32) for labels in (loaded.labels, *loaded.overlaps)]


def _find_in_layer(
    paths: FeaturePaths, said: Int8[ndarray, " n"], maps: Sequence[Int32[ndarray, "_ _"]]
) -> list[ShownThing]:
    """Things that move, by the label maps of one layer."""
    links = link_regions(paths, maps)
    moving = find_moving_strands(paths, said, links)
    standing = find_standing_strands(paths, said, links)
    groups = group_strands(paths, links, moving, maps)
    return [_show(_follow_on(group, links, standing, maps), maps) for group in groups]


def _follow_on(
    group: Int64[ndarray, " g"],
    links: RegionLinks,
    standing: Bool[ndarray, " s"],
    maps: Sequence[Int32[ndarray, "_ _"]],
) -> dict[int, list[int]]:
    """The labels of a thing by photo, those included that no corner was followed to."""
    labels: dict[int, list[int]] = {}
    for region in group.tolist():
        labels.setdefault(int(links.photos[region]), []).append(int(links.labels[region]))
    fixed = np.flatnonzero(standing[links.strands])
    taken = {(int(links.photos[region]), int(links.labels[region])) for region in fixed}
    return follow_by_overlap(labels, taken, maps)


def _show(labels: dict[int, list[int]], maps: Sequence[Int32[ndarray, "_ _"]]) -> ShownThing:
    """The pixels of a thing, by photo."""
    return {photo: np.isin(maps[photo], labels[photo]) for photo in sorted(labels)}


def _describe(shown: ShownThing, frames: Sequence[Frame]) -> SeenMover:
    sightings = []
    for photo, inside in shown.items():
        rows, columns = np.flatnonzero(inside.any(axis=1)).tolist(), np.flatnonzero(inside.any(axis=0)).tolist()
        height, width = inside.shape
        corners = columns[0] / width, rows[0] / height, (columns[-1] + 1) / width, (rows[-1] + 1) / height
        left, top, right, bottom = (round(corner, 4) for corner in corners)
        sightings.append(Sighting(frames[photo].view.index, (left, top, right, bottom)))
    return SeenMover(frames[0].view.name, tuple(sightings))


def _stands_on_ground(mover: SeenMover, frames: Sequence[Frame]) -> bool:
    """Whether its lower edge lies below the horizon: skylines, wires and clouds look as if they moved, too."""
    cameras = {frame.view.index: frame.view.camera for frame in frames}
    dips = []
    for sighting in mover.sightings:
        camera, (left, _, right, bottom) = cameras[sighting.step], sighting.box
        local = np.array(
            [
                ((left + right) / 2 * camera.width - camera.cx) / camera.fx,
                (bottom * camera.height - camera.cy) / camera.fy,
                1.0,
            ]
        )
        ray = camera.world_from_camera[:3, :3] @ local
        dips.append(-ray[2] / np.linalg.norm(ray))
    return float(np.median(dips)) > _LEAST_DIP
