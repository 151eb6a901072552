"""Choosing a view that shows the dense part of a scene: large, and not through what stands in the way.

Pure functions on points and viewpoints. Angles in radians, distances in metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_app.camera import NEAREST_PIVOT, find_main_box, frame_box
from instdrive_app.sights import Sight
from instdrive_app.state import Intrinsics, Viewpoint, make_default_viewpoint
from instdrive_core.scene.camera import look_at

CORE_SHARES = (0.75, 0.95)
"""Shares of the points that the densest cells hold, in the coarse and in the fine search for the core."""
POINTS_PER_CELL, MOST_ACROSS = 8, 24
"""Points that a cell holds if they fill the box of most points evenly, and cells along its longest side at most."""
FILL = 0.8
"""Share of the picture's height that the core takes, or of its width where it is broad."""
MAX_BLOCKING = 0.01
"""Share of the picture, in points of the scene, that may be blocked without another direction being tried."""
MAX_COVERED = 0.25
"""Area of what is before a thing, as a share of the thing's in the picture, without another direction being tried."""
ABOVE = 0.35
"""Steeper than any photo by this much (vertical part of the direction), a user looks from above and stays there."""
APART = 0.15
"""Radians between photos' lines of sight from which on both are tried."""
MOST_ZOOM = 6.0
"""Times that a photo is magnified where a thing is far."""
_ELEVATIONS = (0.0, 0.25, 0.5, 0.8, 1.1, 1.35)
_AZIMUTHS = (0.0, 0.5, -0.5, 1.0, -1.0, np.pi)
_STEPS, _SHIFTS, _MOST_FITTED = 30, 5, 2000


def find_dense_core(points: Float[ndarray, "n 3"]) -> Float[ndarray, "m 3"]:
    """Find the points in the densest cells, first coarsely, then finely: neither floaters nor far scenery."""
    for share in CORE_SHARES:
        points = _find_densest(points, share)
    return points


def _find_densest(points: Float[ndarray, "n 3"], share: float) -> Float[ndarray, "m 3"]:
    """Find the points in the densest cells, which hold this share of them."""
    low, high = np.percentile(points, [5, 95], axis=0)
    across = float(np.clip(np.cbrt(len(points) / POINTS_PER_CELL), 2, MOST_ACROSS))
    size = max(float((high - low).max()) / across, 1e-6)
    cells = np.floor(np.clip((points - low) / size, -1e6, 1e6)).astype(np.int64)
    _, cell, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    densest = np.argsort(-counts, kind="stable")
    needed = int(np.searchsorted(np.cumsum(counts[densest]), share * len(points))) + 1
    is_dense = np.zeros(len(counts), bool)
    is_dense[densest[:needed]] = True
    return points[is_dense[cell.reshape(-1)]]


def frame_core(viewpoint: Viewpoint, points: Float[ndarray, "n 3"]) -> Viewpoint:
    """Show the dense core of the points (at least one) over 80 % of the picture, roughly in the present direction.

    Where points lie between camera and core, the view rises or turns until fewer are in the way.
    """
    core = find_dense_core(points)
    core = core[:: 1 + len(core) // _MOST_FITTED]
    best, fewest = None, np.inf
    for direction in _list_directions(viewpoint.forward):
        found = _fit_distance(viewpoint, core, direction)
        blocking = _measure_blocking(found, points, core) / len(points)
        if blocking < fewest:
            best, fewest = found, blocking
        if blocking <= MAX_BLOCKING:
            break
    assert best is not None
    return best


def frame_thing(
    viewpoint: Viewpoint,
    points: Float[ndarray, "n 3"],
    others: Float[ndarray, "m 3"],
    areas: Float[ndarray, " m"],
    sights: Sequence[Sight] = (),
) -> Viewpoint:
    """Frame most of a thing's points (at least one), roughly in the present direction.

    Where `others`, splats that are shown and cover `areas` (m²), lie before the thing, the view rises or turns until
    less is in the way. Where photos show the thing (`sights`), it is looked at from the place of one, zoomed if it is
    far: what is seen from elsewhere is noise. A view from above stays one.
    """
    low, high = find_main_box(points)
    inside = points[:: 1 + len(points) // _MOST_FITTED]
    best, least = None, np.inf
    for found in _list_views(viewpoint, low, high, sights):
        covering = _measure_covering(found, others, areas, inside)
        if best is None or covering < least:
            best, least = found, covering
        if least <= MAX_COVERED:
            break
    assert best is not None
    return best


def _list_views(
    viewpoint: Viewpoint, low: Float[ndarray, "3"], high: Float[ndarray, "3"], sights: Sequence[Sight]
) -> Iterator[Viewpoint]:
    """Views of a box to try: those from photos' places, first the one most like now, else from all around."""
    present = frame_box(viewpoint, low, high)
    ways = present.pivot - np.array([each.place for each in sights]).reshape(-1, 3)
    slopes = ways[:, 2] / np.maximum(np.linalg.norm(ways, axis=1), 1e-6)
    if not sights or viewpoint.forward[2] < slopes.min() - ABOVE:
        yield present
        for direction in _list_directions(viewpoint.forward):
            yield frame_box(viewpoint, low, high, direction)
        return
    for sight in _sort_sights(sights, present):
        yield _look_like(sight, low, high)


def _sort_sights(sights: Sequence[Sight], wanted: Viewpoint) -> list[Sight]:
    """The photos' places by how much they differ from a wanted viewpoint; none twice in about the same direction.

    A thing that is twice as far is as bad as one that is seen from 40° beside, or that has driven as far as it is away.
    """
    ways = wanted.pivot - np.array([each.place for each in sights])
    distances = np.maximum(np.linalg.norm(ways, axis=1), 1e-6)
    directions = ways / distances[:, None]
    turns = np.arccos(np.clip(directions @ wanted.forward, -1, 1))
    costs = turns + np.abs(np.log(distances / wanted.pivot_distance)) + [each.driven for each in sights] / distances
    kept: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        if all(directions[index] @ directions[other] < np.cos(APART) for other in kept):
            kept.append(int(index))
    return [sights[index] for index in kept]


def _look_like(sight: Sight, low: Float[ndarray, "3"], high: Float[ndarray, "3"]) -> Viewpoint:
    """Look at a box from the place of a photo, zoomed so that it is large."""
    center = (low + high) / 2
    distance = max(float(np.linalg.norm(center - sight.place)), NEAREST_PIVOT)
    fitting = frame_box(Viewpoint(np.eye(4), sight.lens), low, high)
    zoom = float(np.clip(distance / fitting.pivot_distance, 1, MOST_ZOOM))
    return Viewpoint(look_at(sight.place, center), sight.lens, distance, zoom=zoom)


def frame_scene(means: Float[ndarray, "n 3"]) -> Viewpoint:
    """Choose the first viewpoint of a scene without cameras."""
    return frame_core(make_default_viewpoint(), means) if len(means) else make_default_viewpoint()


def _list_directions(forward: Float[ndarray, "3"]) -> Iterator[Float[ndarray, "3"]]:
    """Unit viewing directions to try: the present one, at least a little downwards, then steeper and turned ones."""
    azimuth = np.arctan2(forward[1], forward[0]) if np.hypot(forward[0], forward[1]) > 1e-6 else np.pi / 2
    least = float(np.clip(-np.arcsin(np.clip(forward[2], -1, 1)), 0.25, 1.35))
    for elevation in sorted({least, *(angle for angle in _ELEVATIONS if angle > least)}):
        for turn in _AZIMUTHS:
            level = np.cos(elevation)
            yield np.array(
                [level * np.cos(azimuth + turn), level * np.sin(azimuth + turn), -np.sin(elevation)], np.float64
            )


def _fit_distance(viewpoint: Viewpoint, core: Float[ndarray, "m 3"], direction: Float[ndarray, "3"]) -> Viewpoint:
    """Look along `direction` at the core from where it takes `FILL` of the height or, if broad, of the width."""
    lens, center = viewpoint.lens, np.percentile(core, [1, 99], axis=0).mean(axis=0)
    turned = look_at(center - direction, center)[:3, :3]
    distance = _find_distance((core - center) @ turned, lens)
    for _ in range(_SHIFTS):  # seen in perspective its middle is elsewhere
        extents = _measure_extents((core - center) @ turned, distance, lens.fx, lens.fy)
        if extents is None:
            break
        # Half the way: what is near moves by more than the middle does.
        center = center + turned[:, :2] @ (np.add(*extents) / 4 * distance / [lens.fx, lens.fy])
        distance = _find_distance((core - center) @ turned, lens)
    return Viewpoint(look_at(center - distance * direction, center), lens, distance)


def _find_distance(local: Float[ndarray, "m 3"], lens: Intrinsics) -> float:
    """Find the distance from which points around the origin, in the axes of the camera, take `FILL` of the picture."""
    radius = max(float(np.abs(local).max()), NEAREST_PIVOT / 10)
    wanted = np.array([lens.width, lens.height]) * FILL
    near, far = 0.0, 100.0 * radius * max(lens.fx, lens.fy) / min(lens.width, lens.height)
    for _ in range(_STEPS):
        middle = (near + far) / 2
        extents = _measure_extents(local, middle, lens.fx, lens.fy)
        is_large = extents is None or np.any(np.subtract(extents[1], extents[0]) > wanted)
        near, far = (middle, far) if is_large else (near, middle)
    return max(far, NEAREST_PIVOT)


def _measure_extents(
    local: Float[ndarray, "m 3"], distance: float, fx: float, fy: float
) -> tuple[Float[ndarray, "2"], Float[ndarray, "2"]] | None:
    """Pixels from the middle between which 98 % of points lie: left top and right bottom; None if too near."""
    depths = local[:, 2] + distance
    if depths.min() < 0.02 * distance:
        return None
    low, high = np.percentile(local[:, :2] / depths[:, None] * [fx, fy], [1, 99], axis=0)
    return low, high


def _measure_blocking(view: Viewpoint, points: Float[ndarray, "n 3"], core: Float[ndarray, "m 3"]) -> float:
    """Measure how much stands before the core: points, each by how much larger it looks than those of the core."""
    pose = view.world_from_camera
    local, inner = (points - pose[:3, 3]) @ pose[:3, :3], (core - pose[:3, 3]) @ pose[:3, :3]
    nearest = float(np.percentile(inner[:, 2], 1))
    low, high = np.percentile(inner[:, :2] / np.maximum(inner[:, 2:], 1e-6), [1, 99], axis=0)
    depths = np.maximum(local[:, 2], 1e-3 * view.pivot_distance)
    places = local[:, :2] / depths[:, None]
    is_before = ((places > low) & (places < high)).all(axis=1) & (local[:, 2] > 0) & (depths < 0.9 * nearest)
    is_close = np.linalg.norm(local, axis=1) < 0.1 * view.pivot_distance
    return float(np.count_nonzero(is_close) + ((nearest / depths[is_before]) ** 2).sum())


def _measure_covering(
    view: Viewpoint, others: Float[ndarray, "m 3"], areas: Float[ndarray, " m"], inside: Float[ndarray, "n 3"]
) -> float:
    """Measure the area in the picture of what stands before a thing, as a share of the rectangle around the thing."""
    pose = view.world_from_camera
    local, inner = (others - pose[:3, 3]) @ pose[:3, :3], (inside - pose[:3, 3]) @ pose[:3, :3]
    nearest = float(np.percentile(inner[:, 2], 1))
    low, high = np.percentile(inner[:, :2] / np.maximum(inner[:, 2:], 1e-6), [2, 98], axis=0)
    depths = np.maximum(local[:, 2], 0.02 * view.pivot_distance)
    places = local[:, :2] / depths[:, None]
    is_before = ((places > low) & (places < high)).all(axis=1) & (local[:, 2] > 0) & (depths < 0.95 * nearest)
    return float((areas[is_before] / depths[is_before] ** 2).sum() / max(float(np.prod(high - low)), 1e-9))
