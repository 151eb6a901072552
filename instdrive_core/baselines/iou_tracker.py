"""An IoU tracker of masks, in place of the video tracker (DEVA) that Gaussian Grouping takes its mask IDs from.

DEVA carries a mask into the next photo by a trained video network. Here the frozen geometry carries it: the sampled
pixels of a mask are points on surfaces (of an actor where an actor's Gaussian is in front), and these fall on pixels
of any other photo, of the same camera or of another. The IoU of a carried mask and a mask found there is

    1 / (1/f + 1/b - 1),  f: share of the first's samples that fall into the second, b: the same backwards,

both among samples that fall into the other photo at all. It does not depend on how densely a mask was sampled.
Photos are visited by time, then camera; each mask gets the track whose last masks it fits best, one to one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

from instdrive_core.baselines.surface_points import SurfacePoints, find_surface_points
from instdrive_core.scene.camera import Camera
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import CachedView
from instdrive_core.training.views.view_store import ViewStore


@dataclass(frozen=True)
class TrackerConfig:
    """When two masks show one thing."""

    min_iou: float = 0.35
    """Below this a mask is a new thing."""
    memory: int = 10
    """Time steps that a track is looked for after it was last seen."""
    min_overlap: int = 5
    """Two photos say something about two masks if so many samples of each fall into the other photo."""
    min_views: int = 5
    """Tracks of fewer masks are taken for faults: their pixels train nothing."""


@dataclass(frozen=True)
class MaskTracks:
    """An ID for every mask of every view."""

    by_view: tuple[Int64[ndarray, " _"], ...]
    """Track of each segment of each cached view, -1 = none."""
    count: int
    """K: tracks are numbered 0 … K - 1."""


@dataclass
class _SeenView:
    """A view as others look at it."""

    camera: Camera
    step: int
    name: str
    world_from_node: Float64[ndarray, "n 4 4"]
    present: Bool[ndarray, " n"]
    points: SurfacePoints
    segment: Int64[ndarray, " p"]
    """Mask of each point."""
    count: int
    mask_at: Int64[ndarray, " q"]
    """Mask of each pixel of the image, -1 = none."""


@dataclass
class _Tracks:
    """Every track's latest mask in each camera."""

    latest: list[dict[str, tuple[int, int]]] = field(default_factory=list)
    """Number of the view and segment of each track's last mask, by camera."""
    masks: list[int] = field(default_factory=list)
    """Masks of each track so far."""

    def candidates(self, views: dict[int, _SeenView], since: int) -> dict[int, list[tuple[int, int]]]:
        """Pairs (track, segment) to compare with, by view not older than the step `since`."""
        found: dict[int, list[tuple[int, int]]] = {}
        for track, places in enumerate(self.latest):
            for view, segment in places.values():
                if views[view].step >= since:
                    found.setdefault(view, []).append((track, segment))
        return found

    def add(self, track: int, camera: str, view: int, segment: int) -> None:
        """Add a mask to the track, or to a new one where `track` is -1."""
        if track < 0:
            self.latest.append({})
            self.masks.append(0)
        self.latest[track][camera] = view, segment
        self.masks[track] += 1


def track_masks(model: SceneModel, store: ViewStore, cached: list[CachedView], config: TrackerConfig) -> MaskTracks:
    """Track all masks; the same input gives the same IDs."""
    order = sorted(range(len(cached)), key=lambda i: (store.facts[cached[i].number].step, cached[i].number))
    tracks, views = _Tracks(), {}
    chosen: list[Int64[ndarray, " _"]] = [np.zeros(0, np.int64)] * len(cached)
    for number in order:
        view = views[number] = _observe_view(model, store, cached[number])
        views = {i: v for i, v in views.items() if v.step >= view.step - config.memory or _is_latest(i, tracks)}
        scores = _score_tracks(view, tracks, views, config)
        chosen[number] = _assign_tracks(scores, config.min_iou)
        for segment, track in enumerate(chosen[number].tolist()):
            chosen[number][segment] = track if track >= 0 else len(tracks.latest)
            tracks.add(track, view.name, number, segment)
    store.release()
    return _renumber_tracks(chosen, np.array(tracks.masks, np.int64), config.min_views)


def _is_latest(number: int, tracks: _Tracks) -> bool:
    return any(view == number for places in tracks.latest for view, _ in places.values())


def _observe_view(model: SceneModel, store: ViewStore, cached: CachedView) -> _SeenView:
    view = store.get(cached.number)
    assert view.labels is not None
    labels, segment = view.labels.ravel(), cached.segments.segment.numpy()
    segment_of_label = np.full(int(labels.max()) + 1, -1, np.int64)
    segment_of_label[labels[cached.pixels]] = segment
    poses = model.actor_poses.at(view.time, model.corrections, view.camera.lag)
    return _SeenView(
        camera=view.camera,
        step=store.facts[cached.number].step,
        name=view.key.rsplit("/", 1)[0],
        world_from_node=poses.matrices,
        present=poses.present,
        points=find_surface_points(model, cached, view.camera, view.time),
        segment=segment,
        count=cached.segments.count,
        mask_at=segment_of_label[labels].astype(np.int64),
    )


def _score_tracks(
    view: _SeenView, tracks: _Tracks, views: dict[int, _SeenView], config: TrackerConfig
) -> Float64[ndarray, "t m"]:
    """Compute the best IoU of each track's remembered masks with each mask of the view."""
    scores = np.zeros((len(tracks.latest), view.count))
    for number, pairs in tracks.candidates(views, view.step - config.memory).items():
        track, segment = np.array(pairs).T
        overlap = compute_carried_iou(views[number], view, config.min_overlap)[segment]
        scores[track] = np.maximum(scores[track], overlap)
    return scores


def compute_carried_iou(one: _SeenView, other: _SeenView, min_overlap: int) -> Float64[ndarray, "m k"]:
    """Compute the IoU of each mask of one view, carried into another, with each mask there.

    It is 0 where the views hardly overlap.
    """
    forward, there = _count_landed(one, other)
    backward, back = _count_landed(other, one)
    known = (there >= min_overlap)[:, None] & (back >= min_overlap)[None]
    f = forward / np.maximum(there, 1)[:, None]
    b = (backward / np.maximum(back, 1)[:, None]).T
    return np.where(known, f * b / np.maximum(f + b - f * b, 1e-12), 0.0)


def _count_landed(one: _SeenView, other: _SeenView) -> tuple[Float64[ndarray, "m k"], Float64[ndarray, " m"]]:
    """Count the samples of each mask that fall into each mask of the other view, and into its image at all."""
    pixels = one.points.pixels_in(other.camera, other.world_from_node, other.present)
    inside = pixels >= 0
    segment, found = one.segment[inside], other.mask_at[pixels[inside]]
    hit = found >= 0
    counts = np.bincount(segment[hit] * other.count + found[hit], minlength=one.count * other.count)
    within = np.bincount(segment, minlength=one.count)
    return counts.reshape(one.count, other.count).astype(np.float64), within.astype(np.float64)


def _assign_tracks(scores: Float64[ndarray, "t m"], min_iou: float) -> Int64[ndarray, " m"]:
    """Assign a track to each mask, one to one, as well as possible; -1 = a new one."""
    chosen = np.full(scores.shape[1], -1, np.int64)
    tracks, masks = linear_sum_assignment(np.where(scores >= min_iou, scores, 0), maximize=True)
    good = scores[tracks, masks] >= min_iou
    chosen[masks[good]] = tracks[good]
    return chosen


def _renumber_tracks(chosen: list[Int64[ndarray, " _"]], masks: Int64[ndarray, " t"], min_views: int) -> MaskTracks:
    """Number the tracks with enough masks 0 … K - 1. Where a scene has none of them, all count."""
    kept = masks >= min_views if (masks >= min_views).any() else masks > 0
    numbers = np.where(kept, np.cumsum(kept) - 1, -1)
    return MaskTracks(tuple(numbers[track] for track in chosen), int(kept.sum()))
