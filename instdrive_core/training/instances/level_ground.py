"""Pieces of one road that segmenters keep apart are joined: LiDAR tells that they meet without a step.

Cars that stand on a road, and its own size, cut it into several masks, in each photo the same ones. No photo shows that
they belong together; but a road is level where its pieces meet, while a kerb stands between it and the pavement.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt16
from numpy import ndarray
from scipy.ndimage import uniform_filter
from scipy.spatial import KDTree

from instdrive_core.training.instances.ground_height import find_ground_groups

REACH = 0.6
"""Metres within which Gaussians tell what a LiDAR point lies on."""
NEIGHBORS = 8
"""Gaussians that are asked at most."""
BLUR = 0.1
"""Metres: nearer Gaussians count hardly more than one at this distance."""
CELL = 0.5
"""Metres along a side of the cells whose heights and colours are compared."""
NEAREST, FARTHEST = 2.9, 4.1
"""Cells from one side of a border to the other: on the border itself, points of both are mixed."""
SLOPE_CELLS = 25
"""Cells along a side of the squares whose slope is no step."""
STEP = 0.025
"""Metres, a quarter of a kerb; pieces of one road differ by half as much. PandaSet's pavements rise by 0.03 to 0.12."""
COLOR_DIFFERENCE = 0.1
"""Difference in a channel of 0 to 1 above which two surfaces are of other stuff, or in other light."""
MIN_MEETINGS = 8
"""Pairs of cells from which on two pieces meet; fewer tell nothing."""
ENCLOSED = 0.8
"""Share of a piece's meetings that must be with one other, whose shade it may be."""
TINT = 0.3
"""Most that the logarithms of what remains may differ between channels: shade takes about as much from each, but the
sky's light is bluer than the sun's."""
FAINTEST = 0.02
"""Darker channels count as this bright."""


@dataclass(frozen=True)
class _Meetings:
    """What two groups measure of each other where they meet."""

    steps: Float32[ndarray, " k"]
    """Metres that the group with the higher number lies above the other."""
    colors: Float32[ndarray, "k 3"]
    """What its colour is more."""
    ratios: Float32[ndarray, "k 3"]
    """Logarithm of how many times brighter it is."""

    def is_level(self) -> bool:
        """Whether there are enough of them, and half of them neither rise nor fall."""
        return len(self.steps) >= MIN_MEETINGS and abs(float(np.median(self.steps))) <= STEP

    def is_shade(self) -> bool:
        """Whether one may be the other in another light."""
        return self.is_level() and float(np.ptp(np.median(self.ratios, axis=0))) <= TINT

    def join(self, other: _Meetings) -> _Meetings:
        """Join what was measured of two pairs."""
        parts = zip(astuple(self), astuple(other), strict=True)
        return _Meetings(*(np.concatenate(pair) for pair in parts))

    def turn(self) -> _Meetings:
        """Turn it around: what the other one is more."""
        return _Meetings(-self.steps, -self.colors, -self.ratios)

    def measure_difference(self) -> float:
        """Measure how much of the most that pieces of one surface may differ half of them do: above 1 they are two."""
        if not self.is_level():
            return math.inf
        step, colors = abs(float(np.median(self.steps))), np.abs(np.median(self.colors, axis=0))
        return max(step / STEP, float(colors.max()) / COLOR_DIFFERENCE)


def join_level_ground(
    groups: Int64[ndarray, " n"],
    weights: Float32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    colors: Float32[ndarray, "n 3"],
    ground: Float32[ndarray, "p 3"],
    heights: Float32[ndarray, " n"],
) -> Int64[ndarray, " n"]:
    """Give all pieces of ground that meet without a step, in the same colour, one group: the one that most points show.

    Args:
        groups: of each Gaussian; -1 = none.
        weights: how much of the photos each shows; 0 = it has no say.
        nodes: 0 = it stands still; others have no say.
        means: metres, in the world.
        colors: RGB, 0 to 1.
        ground: LiDAR points of the ground, in the world; z is up.
        heights: metres above it (`measure_heights`).
    """
    is_ground = find_ground_groups(groups, weights, nodes, heights)
    told = np.flatnonzero((weights > 0) & (groups >= 0) & (nodes == 0))
    if not len(told) or not len(ground) or np.count_nonzero(is_ground) < 2:
        return groups
    labels, shown = _label_points(ground, means[told], groups[told], weights[told], colors[told])
    chosen = np.flatnonzero(labels >= 0)
    chosen = chosen[is_ground[labels[chosen]]]
    if not len(chosen):
        return groups
    sizes = np.bincount(labels[chosen], minlength=len(is_ground))
    names = _join(_measure_meetings(ground[chosen], labels[chosen], shown[chosen]), sizes)
    return np.where(groups >= 0, names[groups], -1)


def _label_points(
    points: Float32[ndarray, "p 3"],
    means: Float32[ndarray, "m 3"],
    groups: Int64[ndarray, " m"],
    weights: Float32[ndarray, " m"],
    colors: Float32[ndarray, "m 3"],
) -> tuple[Int64[ndarray, " p"], Float32[ndarray, "p 3"]]:
    """Find the group and colour that the nearest Gaussians give to each LiDAR point; -1 where none is near."""
    near = min(NEIGHBORS, len(means))
    tree = KDTree(means)
    distances, found = tree.query(points, near, distance_upper_bound=REACH, workers=numba.get_num_threads())
    distances, found = distances.reshape(-1, near), found.reshape(-1, near)
    asked = np.minimum(found, len(means) - 1)
    ballots = np.where(np.isfinite(distances), weights[asked] / (distances**2 + BLUR**2), 0)
    named = groups[asked]
    sums = np.stack([(ballots * (named == named[:, [k]])).sum(axis=1) for k in range(near)], axis=1)
    best = np.argmax(sums, axis=1)[:, None]
    labels = np.take_along_axis(named, best, axis=1)
    agreeing = np.where(named == labels, ballots, 0)
    total = agreeing.sum(axis=1)
    shown = np.einsum("pk,pkc->pc", agreeing, colors[asked]) / np.maximum(total, 1e-12)[:, None]
    return np.where(total > 0, labels[:, 0], -1), shown.astype(np.float32)


def _measure_meetings(
    points: Float32[ndarray, "p 3"], labels: Int64[ndarray, " p"], colors: Float32[ndarray, "p 3"]
) -> dict[tuple[int, int], _Meetings]:
    """Compare cells of different groups across their border, by pair of groups in ascending order."""
    cells = np.floor(points[:, :2] / CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    entries, entry = np.unique(np.column_stack([cells, labels]), axis=0, return_inverse=True)
    counts = np.bincount(entry.ravel())
    values = np.column_stack([points, colors]).astype(np.float64)
    middles = np.stack([np.bincount(entry.ravel(), column) / counts for column in values.T], axis=1)
    slopes = _measure_slopes(entries[:, :2], middles[:, :3])
    pairs = _find_pairs(entries[:, :2])
    pairs = pairs[entries[pairs[:, 0], 2] != entries[pairs[:, 1], 2]]
    turned = entries[pairs[:, 0], 2] > entries[pairs[:, 1], 2]
    pairs[turned] = pairs[turned][:, ::-1]
    differences = middles[pairs[:, 1]] - middles[pairs[:, 0]]
    differences[:, 2] -= (slopes[pairs].mean(axis=1) * differences[:, :2]).sum(axis=1)
    logarithms = np.log(np.maximum(middles[:, 3:], FAINTEST))
    differences = np.column_stack([differences[:, 2:], logarithms[pairs[:, 1]] - logarithms[pairs[:, 0]]])
    differences = differences.astype(np.float32)
    between, pair = np.unique(entries[pairs, 2], axis=0, return_inverse=True)
    meetings = {}
    for number, (one, other) in enumerate(between.tolist()):
        part = differences[pair.ravel() == number]
        meetings[one, other] = _Meetings(part[:, 0], part[:, 1:4], part[:, 4:])
    return meetings


def _find_pairs(cells: Int64[ndarray, "e 2"]) -> Int64[ndarray, "k 2"]:
    """Find the pairs of entries whose cells lie across a border from each other."""
    pairs = KDTree(cells.astype(np.float64)).query_pairs(FARTHEST, output_type="ndarray")
    apart = np.linalg.norm(cells[pairs[:, 0]] - cells[pairs[:, 1]], axis=1)
    return pairs[apart >= NEAREST]


def _measure_slopes(cells: Int64[ndarray, "e 2"], middles: Float64[ndarray, "e 3"]) -> Float64[ndarray, "e 2"]:
    """Fit a plane to all cells around each one: metres that the ground rises for each metre along x and y."""
    shape = tuple((cells.max(axis=0) + 1).tolist())
    x, y, z = (middles - middles.mean(axis=0)).T

    def average(values: ndarray) -> ndarray:
        grid = np.zeros(shape)
        np.add.at(grid, (cells[:, 0], cells[:, 1]), values)
        return uniform_filter(grid, SLOPE_CELLS, mode="constant")[cells[:, 0], cells[:, 1]]

    count = average(np.ones_like(x))
    mean_x, mean_y, mean_z = (average(values) / count for values in (x, y, z))
    xx, xy, yy = (
        average(x * x) / count - mean_x**2,
        average(x * y) / count - mean_x * mean_y,
        average(y * y) / count - mean_y**2,
    )
    xz, yz = average(x * z) / count - mean_x * mean_z, average(y * z) / count - mean_y * mean_z
    xx, yy = xx + CELL**2 / 12, yy + CELL**2 / 12
    determinant = xx * yy - xy**2
    return np.stack([(yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant], axis=1)


def _join(meetings: dict[tuple[int, int], _Meetings], sizes: Int64[ndarray, " g"]) -> Int64[ndarray, " g"]:
    """Join the two that differ least, time and again; what was joined meets others as one.

    So a driveway, level with the road and with the pavement, does not join these two: a kerb is most of their border.
    Nor does a patch in the shade come between two pieces in the sun because it meets one of them most often: it joins
    what is around it last.
    """
    names = np.arange(len(sizes))
    while pair := _find_alike(meetings) or _find_shaded(meetings):
        kept, gone = sorted(pair, key=lambda group: (-sizes[names == group].sum(), group))
        names[names == gone] = kept
        meetings = _unite(meetings, kept, gone)
    return names


def _find_alike(meetings: dict[tuple[int, int], _Meetings]) -> tuple[int, int] | None:
    """Find the two that differ least, if so little that they are one."""
    differences = {pair: meeting.measure_difference() for pair, meeting in meetings.items()}
    pair = min(differences, key=lambda pair: (differences[pair], pair), default=None)
    return pair if pair is not None and differences[pair] <= 1 else None


def _find_shaded(meetings: dict[tuple[int, int], _Meetings]) -> tuple[int, int] | None:
    """Find a piece that is level with the only other one around it, and looks like that in another light."""
    total: dict[int, int] = {}
    for pair, meeting in meetings.items():
        for group in pair:
            total[group] = total.get(group, 0) + len(meeting.steps)
    for pair, meeting in sorted(meetings.items(), key=lambda entry: (-len(entry[1].steps), entry[0])):
        if len(meeting.steps) >= ENCLOSED * min(total[group] for group in pair) and meeting.is_shade():
            return pair
    return None


def _unite(meetings: dict[tuple[int, int], _Meetings], kept: int, gone: int) -> dict[tuple[int, int], _Meetings]:
    """Let a group meet what another one met, too."""
    united: dict[tuple[int, int], _Meetings] = {}
    for (low, high), meeting in meetings.items():
        one, other = (kept if group == gone else group for group in (low, high))
        if one == other:
            continue
        if one > other:
            one, other, meeting = other, one, meeting.turn()
        known = united.get((one, other))
        united[one, other] = meeting if known is None else known.join(meeting)
    return united
