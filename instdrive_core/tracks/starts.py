"""First guesses of a thing's trajectory, from which poses are solved."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.tracks.linking import Chain
from instdrive_core.tracks.pose_graph import SLOW
from instdrive_core.tracks.trajectory import SPACING, Trajectory, even_knots

NOISE = 0.25
"""Metres: standard deviation of places that are smoothed."""
ACCELERATION = 3.0
"""Standard deviation of the white acceleration (m/s² over 0.1 s) that smoothing allows."""
ROUNDS = 4
"""Rounds of smoothing in which outliers count less."""


def gather_linked_places(chain: Chain) -> Float64[ndarray, "c 2"]:
    """Where the first cluster's middle is at each cluster's time, by the displacements found between them."""
    steps = np.array(chain.shifts).reshape(-1, 2)
    return chain.clusters[0].middle + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def middles(chain: Chain) -> Float64[ndarray, "c 2"]:
    """Middles of the boxes around the clusters."""
    return np.array([one.middle for one in chain.clusters])


def smooth(
    times: Float64[ndarray, " t"], places: Float64[ndarray, "t 2"], acceleration: float = ACCELERATION
) -> Trajectory:
    """An even trajectory through places, headed along its way."""
    start, count = even_knots(times)
    at = np.clip((times - start) / SPACING, 0, count - 1)
    before = np.minimum(np.floor(at).astype(int), count - 2)
    fraction = at - before
    design = np.zeros((len(times), count))
    design[np.arange(len(times)), before] = 1 - fraction
    design[np.arange(len(times)), before + 1] += fraction
    bend = np.diff(np.eye(count), 2, axis=0) / (acceleration * SPACING**2)
    weights = np.ones(len(times))
    knots = np.zeros((count, 2))
    for _ in range(ROUNDS):
        scaled = design * (weights / NOISE**2)[:, None]
        normal = design.T @ scaled + bend.T @ bend + 1e-6 * np.eye(count)
        knots = np.linalg.solve(normal, scaled.T @ places)
        off = np.linalg.norm(design @ knots - places, axis=1)
        weights = 1 / (1 + (off / (2 * NOISE)) ** 2)
    return Trajectory(start, np.column_stack([knots, headings(knots)]))


def headings(places: Float64[ndarray, "k 2"]) -> Float64[ndarray, " k"]:
    """Directions of travel at even moments, continuous; where it stands still, as before or after."""
    steps = np.diff(places, axis=0) / SPACING
    speeds = np.linalg.norm(steps, axis=1)
    total = places[-1] - places[0]
    moves = speeds > min(SLOW, 0.7 * max(speeds.max(initial=0), 1e-9))
    yaw = np.full(len(steps), np.arctan2(total[1], total[0]))
    if moves.any():
        known = np.flatnonzero(moves)
        turns = np.unwrap(np.arctan2(steps[known, 1], steps[known, 0]))
        yaw = np.interp(np.arange(len(steps)), known, turns)
    return np.interp(np.arange(len(places)), np.arange(len(yaw)) + 0.5, yaw)


def parabola(times: Float64[ndarray, " t"], places: Float64[ndarray, "t 2"]) -> Trajectory:
    """The evenly accelerated motion that fits places best."""
    start, count = even_knots(times)
    weights = np.ones(len(times))
    basis = np.stack([np.ones_like(times), times - start, (times - start) ** 2], axis=1)
    found = np.zeros((3, 2))
    for _ in range(ROUNDS):
        found = np.linalg.lstsq(basis * weights[:, None], places * weights[:, None], rcond=None)[0]
        off = np.linalg.norm(basis @ found - places, axis=1)
        weights = 1 / (1 + (off / (2 * NOISE)) ** 2)
    moments = np.arange(count) * SPACING
    knots = np.stack([np.ones(count), moments, moments**2], axis=1) @ found
    return Trajectory(start, np.column_stack([knots, headings(knots)]))


def first_guesses(chain: Chain) -> list[Trajectory]:
    """Trajectories to start solving from."""
    times = np.array([one.time for one in chain.clusters])
    return [
        smooth(times, gather_linked_places(chain)),
        smooth(times, middles(chain)),
        parabola(times, middles(chain)),
    ]
