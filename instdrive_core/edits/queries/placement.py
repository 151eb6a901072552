"""Centres, feet, ground and lanes of instances: what gizmos show and constrained moves follow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.ground_height import RADII, estimate_ground_heights
from instdrive_core.edits.queries.isolation import find_isolated
from instdrive_core.errors import EditError
from instdrive_core.maths.activations import sigmoid
from instdrive_core.scene.lane import estimate_street_direction, estimate_travel_direction
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import Similarity, extract_scale
from instdrive_core.wording import phrase

SOLID_OPACITY = 0.3
"""Fainter splats are neither ground nor the foot of anything."""
_FOOT_SHARE = 0.02
"""Share of an instance's solid splats that may hang below its foot."""
_MANY_POINTS, _ALONE = 2000, 3.0
"""Points that show where strays are, and how isolated (`find_isolated`) these are."""
_MIN_PATH = 1.0
"""Metres an actor must drive to have a lane of its own."""
_STREET_SPLATS = 100_000
"""Number of splats, spread over the street, that are enough to tell where it runs."""


def find_solid(opacities: Float[ndarray, " n"]) -> Bool[ndarray, " n"]:
    """Mask of the splats that shape a thing: the opaque ones, or the least faint where all are faint."""
    return opacities >= min(SOLID_OPACITY, opacities.max())


def drop_strays(points: Float[ndarray, "n 3"]) -> Float[ndarray, "k 3"]:
    """Drop points of a thing that lie by themselves; of many points, evenly chosen ones stay.

    Below a parked car splats train where nobody looks, metres deep in the road.
    """
    points = points[:: max(-(-len(points) // _MANY_POINTS), 1)]
    return points[~find_isolated(points, _ALONE)]


def estimate_foot(heights: Float[ndarray, " n"]) -> float:
    """Height on which a thing stands whose solid splats have these heights."""
    return float(np.quantile(heights, _FOOT_SHARE, method="nearest"))


def compute_center(document: Document, ids: Sequence[int], time: float) -> Float64[ndarray, "3"]:
    """The mean of the instances' centres in the world, metres: of their bounds, or of an actor's box at `time` (s)."""
    table, actors = document.scene.table, document.scene.actors
    instances = [table[instance_id] for instance_id in ids]
    centers = np.array([instance.bounds for instance in instances], np.float64).mean(axis=1)
    for place, instance in enumerate(instances):
        if instance.node:
            centers[place] = actors[instance.node - 1].interpolate_pose(time)[:3, 3]
    return centers.mean(axis=0)


def compute_bottom(document: Document, ids: Sequence[int], matrix: Similarity, time: float) -> float:
    """Height (metres) of the lowest foot of the instances after a move [s R | t] in the world."""
    feet = []
    for instance_id in ids:
        node = document.scene.table[instance_id].node
        if node:
            track = document.scene.actors[node - 1]
            center = matrix[:, :3] @ track.interpolate_pose(time)[:3, 3] + matrix[:, 3]
            feet.append(center[2] - extract_scale(matrix) * track.dimensions[2] / 2)
        else:
            rows = document.find_rows((instance_id,))
            opacities = sigmoid(document.scene.gaussians.opacity_logits[rows])
            points = drop_strays(document.compute_means(rows[find_solid(opacities)]))
            feet.append(estimate_foot(points @ matrix[2, :3] + matrix[2, 3]))
    return float(min(feet))


def find_ground_below(document: Document, ids: Sequence[int], place: Float[ndarray, "3"]) -> float:
    """Height (metres) of the ground below a place, without the instances. Raises EditError where there is none."""
    return float(find_ground_heights(document, ids, place[None])[0])


def find_ground_heights(
    document: Document, ids: Sequence[int], places: Float[ndarray, "k 3"]
) -> Float64[ndarray, " k"]:
    """Heights (metres) of the ground below places close to one another, without the instances.

    Raises EditError where there is none below one of them.
    """
    heights = find_ground_along(document, ids, places)
    if not np.isnan(heights).any():
        return heights
    place = places[np.isnan(heights)][0]
    raise EditError(
        phrase(
            "there is no ground within {radius:g} m of x = {x:.1f}, y = {y:.1f}",
            radius=RADII[-1],
            x=place[0],
            y=place[1],
        )
    )


def find_ground_along(document: Document, ids: Sequence[int], places: Float[ndarray, "k 3"]) -> Float64[ndarray, " k"]:
    """Heights (metres) of the ground below the places of a way, without the instances; NaN where there is none.

    The splats are looked at once, however long the way is.
    """
    if not len(places):
        return np.zeros(0)
    low, high = places.min(axis=0), places.max(axis=0)
    reach = float((high - low)[:2].max()) / 2 + RADII[-1]
    return estimate_ground_heights(_gather_background(document, ids, (low + high) / 2, reach), places)


def _gather_background(
    document: Document, ids: Sequence[int], place: Float[ndarray, "3"], reach: float
) -> Float32[ndarray, "k 3"]:
    """Positions of solid background splats of other things within `reach` metres along x and along y."""
    scene = document.scene
    stored, entries = scene.gaussians.means, document.transforms.indices

    def keep_usable(rows: Int64[ndarray, " m"]) -> Int64[ndarray, " k"]:
        usable = (scene.nodes[rows] == 0) & ((document.state.flags[rows] & Flag.DELETED) == 0)
        rows = rows[usable & ~np.isin(scene.instance_ids[rows], np.array(ids, np.uint32))]
        return rows[sigmoid(scene.gaussians.opacity_logits[rows]) >= SOLID_OPACITY]

    settled = document.transforms.find_entry_at_home(document.orientation)
    near = _find_near(stored, place, reach, document.transforms.matrices[settled])
    # Of what was moved, little is of others: during a drag it is mostly the instances themselves.
    moved = document.compute_means(keep_usable(np.flatnonzero(entries != settled)))
    still = document.compute_means(keep_usable(near[entries[near] == settled]))
    return np.concatenate([still, moved[_find_near(moved, place, reach, np.eye(3, 4))]])


def _find_near(
    means: Float32[ndarray, "n 3"], place: Float[ndarray, "3"], reach: float, matrix: Similarity
) -> Int64[ndarray, " k"]:
    """Rows that `matrix` puts within `reach` along x and along y; y is looked at for those only that are near in x."""
    rows: Int64[ndarray, " k"] | slice = slice(None)
    for axis in range(2):
        row, shift = matrix[axis, :3].astype(np.float32), np.float32(matrix[axis, 3] - place[axis])
        (along,) = np.nonzero(row)  # one axis for what was not turned: a third of the work
        places = means[rows, along[0]] * row[along[0]] if len(along) == 1 else means[rows] @ row
        near = np.flatnonzero(np.abs(places + shift) <= np.float32(reach))
        rows = near if isinstance(rows, slice) else rows[near]
    assert not isinstance(rows, slice)
    return rows


def find_lane(document: Document, ids: Sequence[int], place: Float[ndarray, "3"], time: float) -> Float64[ndarray, "3"]:
    """Horizontal unit direction of the lane: of the first moving actor's own drive, else of the recording car's past
    this place, else of the street's longest extent. Raises EditError where there is none of them."""
    scene = document.scene
    for instance_id in ids:
        node = scene.table[instance_id].node
        if node and scene.actors[node - 1].compute_path_length() >= _MIN_PATH:
            forward = scene.actors[node - 1].interpolate_pose(time)[:3, 1] * [1, 1, 0]
            if np.linalg.norm(forward) > 1e-6:
                return forward / np.linalg.norm(forward)
    cameras: dict[str, list[tuple[float, ndarray]]] = {}
    for view in scene.views:
        cameras.setdefault(view.name, []).append((view.time, view.camera.position))
    paths = [np.stack([where for _, where in sorted(film, key=lambda shot: shot[0])]) for film in cameras.values()]
    lane = estimate_travel_direction(paths, place)
    if lane is None:
        street = np.flatnonzero(scene.nodes == 0)
        lane = estimate_street_direction(document.compute_means(street[:: 1 + len(street) // _STREET_SPLATS]), place)
    if lane is None:
        raise EditError("the scene has neither photo cameras nor a street here, so no lane is known")
    return lane
