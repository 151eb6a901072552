"""The box of a thing, from its points in its own frame: what was not seen is taken to be as long as such things are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

TRIM = 0.6
"""Percent of the points beyond each face that do not count."""
TALL = 2.3
"""Metres: higher vehicles are vans, buses and lorries."""
CAR, VAN = (4.6, 1.88), (6.0, 2.4)
"""Length and width in metres of what was seen in part only."""
LOW_CAR, FULL_VAN = 1.7, 2.5
"""Metres in height up to which it is taken to be as long and wide as a car, and from which on as a van: the higher, the
longer."""
HOOD, HOOD_HEIGHT, LOWEST = 1.1, 0.9, 5
"""Metres from a car's front to its windscreen, and height of the hood in between; percent of the points that may lie
lower where others hide it."""
SLIM = ("Pedestrian", "Bicycle")
"""Labels of people, on foot and on two wheels."""
TWO_WHEELER, PERSON = (1.8, 0.7), (0.6, 0.6)
PERSON_LENGTH, PERSON_WIDTH, PERSON_HEIGHTS = 1.25, 1.1, (0.9, 2.2)
"""Metres that a person's points measure at most, and the heights between which they end."""
NARROW, SHORT = 1.15, 2.6
"""Metres: what is narrower and shorter runs on two wheels."""
HEADROOM, OVERHEAD, STRAY = 0.2, 0.4, 0.01
"""Metres of air above somebody's head, share of the points that may lie above it: an awning or a sign that was taken
along, and share that may lie in between."""
GROWN = 0.05
"""Metres by which a box is larger than the points that were met on its faces."""


@dataclass(frozen=True)
class TrackBox:
    """A box in a thing's frame, standing on the ground."""

    center: Float64[ndarray, "2"]
    """Along the heading and to its left, metres."""
    length: float
    width: float
    height: float
    label: str
    """PandaSet's label of such things."""


def fit_box(points: Float64[ndarray, "n 3"], views: Float64[ndarray, "v 2"]) -> TrackBox:
    """The box of a thing. Of a car that faces the sensor over the roofs of others, the windscreen is what is nearest.

    Args:
        points: in its frame, z above the ground, metres.
        views: where the sensors were in its frame, metres.
    """
    low, high = _measure(_drop_overhead(points))
    label, typical = classify_box(high[:2] - low[:2], float(high[2]))
    if label == "Car" and np.percentile(points[:, 2], LOWEST) > HOOD_HEIGHT and np.mean(views[:, 0] > high[0]) > 0.5:
        high[0] += np.clip(typical[0] - (high[0] - low[0]), 0, HOOD)
    for axis in range(2):
        missing = typical[axis] - (high[axis] - low[axis])
        if missing <= 0:
            continue
        front, back = views[:, axis] > high[axis], views[:, axis] < low[axis]
        share = 0.5 if front.sum() == back.sum() else float(front.mean() > back.mean())
        low[axis] -= missing * share
        high[axis] += missing * (1 - share)
    size = high - low
    return TrackBox((low[:2] + high[:2]) / 2, float(size[0]), float(size[1]), max(float(high[2]), 0.5), label)


def _measure(points: Float64[ndarray, "n 3"]) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    low, high = np.percentile(points, TRIM, axis=0), np.percentile(points, 100 - TRIM, axis=0)
    low[:2] -= GROWN / 2
    high[:2] += GROWN / 2
    return low, high


def _drop_overhead(points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "k 3"]:
    """The points without those that hang above a person or a cyclist."""
    heights = np.sort(points[:, 2])
    strays = 1 + int(STRAY * len(heights))
    for last in np.flatnonzero(heights[strays:] - heights[:-strays] >= HEADROOM):
        if last + 1 < (1 - OVERHEAD) * len(heights):
            continue
        below = points[points[:, 2] <= heights[last]]
        if looks_like_person(below):
            return below
    return points


def looks_like_person(points: Float64[ndarray, "n 3"]) -> bool:
    """Whether points in a thing's frame, z above the ground, measure like somebody on foot or on two wheels."""
    low, high = _measure(points)
    return classify_box(high[:2] - low[:2], float(high[2]))[0] in SLIM


def classify_box(size: Float64[ndarray, "2"], height: float) -> tuple[str, tuple[float, float]]:
    """What a thing is, by the extent of its points along and across its heading and by its height, and how long and
    wide such things are at least."""
    length, width = float(size[0]), float(size[1])
    shortest, tallest = PERSON_HEIGHTS
    if max(length, width) < PERSON_LENGTH and min(length, width) < PERSON_WIDTH and shortest < height < tallest:
        return "Pedestrian", PERSON
    if width < NARROW and length < SHORT and height < tallest and length > 0.5:
        return "Bicycle", TWO_WHEELER
    if height > TALL:
        return ("Bus" if length > 7.5 else "Medium-sized Truck"), VAN
    share = np.clip((height - LOW_CAR) / (FULL_VAN - LOW_CAR), 0, 1)
    return "Car", (float(CAR[0] + share * (VAN[0] - CAR[0])), float(CAR[1] + share * (VAN[1] - CAR[1])))
