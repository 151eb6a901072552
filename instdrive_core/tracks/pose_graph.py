"""All poses of a thing solved at once: its surfaces as different sweeps saw them must coincide, and it must move as
things move.

Point-to-plane distances (Chen & Medioni, 1992) between observations near and far in time, linearised and solved by
Gauss and Newton, with priors: white acceleration along the ground and in yaw, heading near the direction of travel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from numba import njit
from numpy import ndarray
from scipy.linalg import cho_factor, cho_solve

from instdrive_core.tracks.observations import Observation
from instdrive_core.tracks.trajectory import SPACING, Trajectory

STRIDES = (1, 2, 4, 8, 16)
"""Observations between those compared."""
REACHES = (0.8, 0.8, 0.6, 0.6, 0.45, 0.45, 0.35, 0.35, 0.25, 0.25, 0.25, 0.25)
"""Metres within which points of two observations are of one place, step by step."""
NOISE = 0.05
"""Metres: standard deviation of a point from its surface."""
INDEPENDENT = 15
"""Points of a pair that count as independent: the others err alike."""
ACCELERATION, YAW_ACCELERATION = 1.5, 0.6
"""Standard deviations of white acceleration, m/s² and rad/s², over 0.1 s."""
SIDEWAYS = np.radians(6.0)
"""Standard deviation of the heading from the direction of travel, radians."""
SLOW = 0.8
"""Metres per second below which the direction of travel says little of the heading."""
CELL = 0.15
"""Metres along an edge of the cells whose number says how well points coincide."""


@dataclass(frozen=True)
class Packed:
    """Observations in arrays, for the kernel."""

    points: ndarray
    normals: ndarray
    lags: ndarray
    starts: Int64[ndarray, " o1"]
    times: Float64[ndarray, " o"]
    anchor: Float64[ndarray, "2"]
    """Subtracted from all places."""


def pack(observations: list[Observation]) -> Packed:
    """Observations in order of time, relative to the middle of the first."""
    observations = sorted(observations, key=lambda one: one.time)
    anchor = observations[0].middle
    points = np.concatenate([one.points for one in observations]).astype(np.float64)
    points[:, :2] -= anchor
    return Packed(
        points,
        np.concatenate([one.normals for one in observations]).astype(np.float64),
        np.concatenate([one.lags for one in observations]).astype(np.float64),
        np.cumsum([0] + [len(one.points) for one in observations]),
        np.array([one.time for one in observations]),
        anchor,
    )


def solve_poses(packed: Packed, guess: Trajectory, reaches: tuple[float, ...] = REACHES) -> Trajectory:
    """The trajectory that makes surfaces coincide, from a first guess (x and y in the world)."""
    knots = guess.knots.copy()
    knots[:, :2] -= packed.anchor
    pairs = _pairs(len(packed.times))
    trajectory = guess.with_knots(knots)
    for step, reach in enumerate(reaches):
        normal, gradient = _prior_terms(trajectory.knots, first=knots)
        _add_points(packed, trajectory, pairs, reach, normal, gradient)
        try:
            change = cho_solve(cho_factor(normal), -gradient).reshape(-1, 3)
        except np.linalg.LinAlgError:
            break
        change[:, :2] = np.clip(change[:, :2], -1.0, 1.0)
        change[:, 2] = np.clip(change[:, 2], -0.3, 0.3)
        trajectory = trajectory.with_knots(trajectory.knots + change)
        if np.abs(change).max() < 0.002 and step > len(reaches) - 4:
            break
    solved = trajectory.knots.copy()
    solved[:, :2] += packed.anchor
    return guess.with_knots(solved)


def in_object_frame(packed: Packed, trajectory: Trajectory) -> Float64[ndarray, "n 3"]:
    """All points in the thing's frame: x along its heading, y to its left, z above the ground."""
    poses, velocities = trajectory.poses_at(packed.times), trajectory.velocities_at(packed.times)
    poses[:, :2] -= packed.anchor
    counts = np.diff(packed.starts)
    pose, velocity = np.repeat(poses, counts, axis=0), np.repeat(velocities, counts, axis=0)
    offset = packed.points[:, :2] - pose[:, :2] - velocity * packed.lags[:, None]
    cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    along = cosine * offset[:, 0] + sine * offset[:, 1]
    left = -sine * offset[:, 0] + cosine * offset[:, 1]
    return np.column_stack([along, left, packed.points[:, 2]])


def count_occupied_cells(packed: Packed, trajectory: Trajectory) -> int:
    """Cells that hold a point: the fewer, the better points of different sweeps coincide."""
    cells = np.floor(in_object_frame(packed, trajectory) / CELL).astype(np.int64)
    return len(np.unique(cells @ np.array([1, 4096, 4096 * 4096])))


def _pairs(count: int) -> Int64[ndarray, "p 2"]:
    pairs = [(first, first + stride) for stride in STRIDES for first in range(count - stride)]
    return np.array(pairs + [(second, first) for first, second in pairs], np.int64).reshape(-1, 2)


def _prior_terms(
    knots: Float64[ndarray, "k 3"], first: Float64[ndarray, "k 3"]
) -> tuple[Float64[ndarray, "n n"], Float64[ndarray, " n"]]:
    """Normal matrix and gradient of the motion priors."""
    count = len(knots)
    normal, gradient = np.zeros((count, 3, count, 3)), np.zeros((count, 3))
    bend = np.array([1.0, -2.0, 1.0])
    sigmas = np.array([ACCELERATION, ACCELERATION, YAW_ACCELERATION]) * SPACING**2
    for knot in range(count - 2):
        here = slice(knot, knot + 3)
        for axis in range(3):
            residual = bend @ knots[here, axis]
            normal[here, axis, here, axis] += np.outer(bend, bend) / sigmas[axis] ** 2
            gradient[here, axis] += bend * residual / sigmas[axis] ** 2
    for knot in range(count - 1):
        velocity = (knots[knot + 1, :2] - knots[knot, :2]) / SPACING
        speed = float(np.linalg.norm(velocity))
        trust = np.clip((speed - 0.5 * SLOW) / SLOW, 0, 1)
        if not trust:
            continue
        yaw = knots[knot : knot + 2, 2].mean()
        across = np.array([-np.sin(yaw), np.cos(yaw)])
        weight = trust / (SIDEWAYS * max(speed, SLOW)) ** 2
        residual = across @ velocity
        turn = -np.array([np.cos(yaw), np.sin(yaw)]) @ velocity / 2
        row = np.zeros((2, 3))
        row[0, :2], row[1, :2] = -across / SPACING, across / SPACING
        row[:, 2] = turn
        normal[knot : knot + 2, :, knot : knot + 2] += weight * row[:, :, None, None] * row[None, None]
        gradient[knot : knot + 2] += weight * residual * row
    # Nothing else says where on the thing its origin is.
    hold = np.array([0.3, 0.3, 0.6]) ** -2.0 / count
    normal[np.arange(count), :, np.arange(count)] += np.diag(hold)
    gradient += hold * (knots - first)
    return normal.reshape(3 * count, 3 * count), gradient.ravel()


def _add_points(
    packed: Packed, trajectory: Trajectory, pairs: ndarray, reach: float, normal: ndarray, gradient: ndarray
) -> None:
    poses, velocities = trajectory.poses_at(packed.times), trajectory.velocities_at(packed.times)
    before, fraction = trajectory.between(packed.times)
    _accumulate(
        packed.points, packed.normals, packed.lags, packed.starts, poses, velocities, before, fraction,
        pairs, reach, normal, gradient,
    )  # fmt: skip


@njit(cache=True, fastmath=True)
def _accumulate(
    points, normals, lags, starts, poses, velocities, before, fraction, pairs, reach, normal_matrix, gradient
) -> None:
    """Add the point-to-plane terms of all pairs to the normal matrix and the gradient, in place."""
    count = len(points)
    local = np.empty((count, 3), np.float32)
    turned = np.empty((count, 3), np.float32)
    for one in range(len(poses)):
        cosine, sine = np.cos(poses[one, 2]), np.sin(poses[one, 2])
        for i in range(starts[one], starts[one + 1]):
            x = points[i, 0] - poses[one, 0] - velocities[one, 0] * lags[i]
            y = points[i, 1] - poses[one, 1] - velocities[one, 1] * lags[i]
            local[i, 0], local[i, 1], local[i, 2] = cosine * x + sine * y, cosine * y - sine * x, points[i, 2]
            turned[i, 0] = cosine * normals[i, 0] + sine * normals[i, 1]
            turned[i, 1] = cosine * normals[i, 1] - sine * normals[i, 0]
            turned[i, 2] = normals[i, 2]
    softness = max(0.1, 0.35 * reach)
    reach_squared = reach * reach
    row = np.zeros(6)
    for p in range(len(pairs)):
        a, b = pairs[p, 0], pairs[p, 1]
        block, vector, matched = np.zeros((6, 6)), np.zeros(6), 0
        cos_a, sin_a = np.cos(poses[a, 2]), np.sin(poses[a, 2])
        cos_b, sin_b = np.cos(poses[b, 2]), np.sin(poses[b, 2])
        for i in range(starts[a], starts[a + 1]):
            best, nearest = np.float32(reach_squared), -1
            for j in range(starts[b], starts[b + 1]):
                x, y, z = local[i, 0] - local[j, 0], local[i, 1] - local[j, 1], local[i, 2] - local[j, 2]
                square = x * x + y * y + z * z
                if square < best:
                    best, nearest = square, j
            if nearest < 0:
                continue
            n_x, n_y, n_z = turned[nearest, 0], turned[nearest, 1], turned[nearest, 2]
            if n_x == 0 and n_y == 0:
                continue
            matched += 1
            residual = n_x * (local[i, 0] - local[nearest, 0]) + n_y * (local[i, 1] - local[nearest, 1])
            residual += n_z * (local[i, 2] - local[nearest, 2])
            scaled = residual / softness
            weight = 1.0 / (1.0 + scaled * scaled) ** 2
            row[0] = -(n_x * cos_a - n_y * sin_a)
            row[1] = -(n_x * sin_a + n_y * cos_a)
            row[2] = n_x * local[i, 1] - n_y * local[i, 0]
            row[3] = n_x * cos_b - n_y * sin_b
            row[4] = n_x * sin_b + n_y * cos_b
            row[5] = n_y * local[nearest, 0] - n_x * local[nearest, 1]
            for r in range(6):
                vector[r] += weight * residual * row[r]
                for s in range(6):
                    block[r, s] += weight * row[r] * row[s]
        if matched < 3:
            continue
        scale = min(matched, INDEPENDENT) / matched / NOISE**2
        for r in range(6):
            one, axis = (a, r) if r < 3 else (b, r - 3)
            for side in range(2):
                share = fraction[one] if side else 1 - fraction[one]
                place = 3 * (before[one] + side) + axis
                gradient[place] += scale * share * vector[r]
                for s in range(6):
                    other, other_axis = (a, s) if s < 3 else (b, s - 3)
                    for other_side in range(2):
                        other_share = fraction[other] if other_side else 1 - fraction[other]
                        normal_matrix[place, 3 * (before[other] + other_side) + other_axis] += (
                            scale * share * other_share * block[r, s]
                        )
