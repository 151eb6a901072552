"""Objects in scenes without instances: solid splats above the ground that hang together in space and colour.

Splats are gathered into small cells. Neighbouring cells always hang together across a small gap, and across a wider
one, which follows from how dense they lie, where their colours are alike. What comes out is an object if it stands on
the ground and has the size of one; façades, trees and the ground stay background.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, UInt32
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.instances.ground_surface import measure_heights_above_ground
from instdrive_core.progress import report

STREET = 30.0
"""Metres: a scene whose middle is at least so wide is taken to be in metres; smaller ones are models of a street."""


@dataclass(frozen=True)
class ObjectConfig:
    """What is an object; lengths are in units of the scene's size, metres on a street."""

    gap: float = 0.3
    """Cells that are nearer hang together."""
    longest: float = 12.0
    """Longer or wider things are background."""
    alike_gap: float = 0.9
    """Cells of like colour hang together up to this …"""
    spacing_factor: float = 2.5
    """… and at most so many times the distance to their fourth neighbour."""
    alike: float = 0.15
    """Largest difference of any channel between like colours, 0 … 1."""
    cell: float = 0.15
    lowest: float = 0.15
    """What is lower above the ground is ground …"""
    highest: float = 5.0
    """… and what is higher is never looked at: trees and houses."""
    tallest: float = 3.6
    """Higher things are background, …"""
    pole_width: float = 1.0
    """… but for those no wider than this."""
    least_height: float = 0.4
    standing: float = 1.5
    """Things whose lower end is higher above the ground hang in the air and are background."""
    min_opacity: float = 0.2
    max_scale: float = 0.6
    """Splats with a larger standard deviation are haze."""
    min_cell_support: float = 0.3
    """Sum of the opacities in a cell with less: it is empty."""
    min_support: float = 12.0
    """Sum of the opacities of an object."""
    rim: float = 0.35
    """Faint splats within this of an object are its own, …"""
    foot: float = 0.05
    """… if they are at least so high above the ground."""


DEFAULT_OBJECTS = ObjectConfig()


def estimate_unit(means: Float[ndarray, "n 3"]) -> float:
    """Estimate the length that is a metre on a street: 1, or less where all of the scene is smaller than a street."""
    finite = means[np.isfinite(means).all(axis=1), :2]
    if not len(finite):
        return 1.0
    low, high = np.quantile(finite, [0.05, 0.95], axis=0)
    return float(np.clip(np.max(high - low) / STREET, 1e-6, 1.0))


def find_objects(
    means: Float[ndarray, "n 3"],
    scales: Float[ndarray, "n 3"],
    colors: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    free: Bool[ndarray, " n"],
    unit: float,
    config: ObjectConfig = DEFAULT_OBJECTS,
) -> UInt32[ndarray, " n"]:
    """Number the objects 1, 2, … by falling support; 0 = ground, background, or not `free`.

    Args:
        means: z is up.
        scales: standard deviations in the scene's lengths.
        colors: 0 … 1.
        opacities: 0 … 1.
        free: which splats may become part of an object; the others tell where the ground is.
        unit: length of the scene that is a metre on a street.
        config: sizes and thresholds.
    """
    numbers = np.zeros(len(means), np.uint32)
    widest = scales.max(axis=1)
    solid = (opacities >= config.min_opacity) & (widest < 2 * config.max_scale * unit)
    heights = measure_heights_above_ground(means, solid, unit) / unit
    report(0.4)
    with np.errstate(invalid="ignore"):
        above = free & (heights > config.lowest) & (heights < config.highest)
    rows = np.flatnonzero(above & (opacities >= config.min_opacity) & (widest < config.max_scale * unit))
    if not len(rows):
        return numbers
    places = means[rows].astype(np.float64) / unit
    parts = _connect_rows(places, colors[rows].astype(np.float64), opacities[rows].astype(np.float64), config)
    report(0.8)
    chosen = _choose_objects(parts, places, heights[rows], opacities[rows].astype(np.float64), config)
    numbers[rows] = chosen
    with np.errstate(invalid="ignore"):
        rim = np.flatnonzero((numbers == 0) & free & (heights > config.foot) & (heights < config.highest))
    own = np.flatnonzero(chosen)
    if len(own) and len(rim):
        found = KDTree(places[own]).query(means[rim] / unit, distance_upper_bound=config.rim)
        distances, nearest = np.asarray(found[0]), np.asarray(found[1])
        near = np.isfinite(distances)
        numbers[rim[near]] = chosen[own[nearest[near]]]
    report(1.0)
    return numbers


def _connect_rows(
    places: Float64[ndarray, "k 3"],
    colors: Float64[ndarray, "k 3"],
    weights: Float64[ndarray, " k"],
    config: ObjectConfig,
) -> Int64[ndarray, " k"]:
    """Number of the component of each splat."""
    cells = np.floor(places / config.cell).astype(np.int64)
    cells -= cells.min(axis=0)
    width = cells.max(axis=0) + 1
    _, cell_of_row = np.unique((cells[:, 0] * width[1] + cells[:, 1]) * width[2] + cells[:, 2], return_inverse=True)
    support = np.bincount(cell_of_row, weights)
    count = len(support)

    def average(values: Float64[ndarray, "k 3"]) -> Float64[ndarray, "m 3"]:
        sums = [np.bincount(cell_of_row, weights * values[:, axis], count) for axis in range(3)]
        return np.stack(sums, axis=1) / support[:, None]

    dense = np.flatnonzero(support >= config.min_cell_support)
    if not len(dense):
        return cell_of_row.astype(np.int64)
    middles, tints = average(places)[dense], average(colors)[dense]
    tree = KDTree(middles)
    spacing = np.atleast_2d(tree.query(middles, k=min(5, len(dense)))[0]).reshape(len(dense), -1)[:, -1]
    reach = np.clip(config.spacing_factor * spacing, config.gap, max(config.gap, config.alike_gap))
    pairs = tree.query_pairs(max(config.gap, config.alike_gap), output_type="ndarray")
    one, other = pairs[:, 0], pairs[:, 1]
    alike = np.abs(tints[one] - tints[other]).max(axis=1, initial=0.0) <= config.alike
    limits = np.where(alike, np.minimum(reach[one], reach[other]), config.gap)
    joined = np.linalg.norm(middles[one] - middles[other], axis=1) <= limits
    ends = dense[one[joined]], dense[other[joined]]
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)[cell_of_row]


def _choose_objects(
    parts: Int64[ndarray, " k"],
    places: Float64[ndarray, "k 3"],
    heights: Float64[ndarray, " k"],
    weights: Float64[ndarray, " k"],
    config: ObjectConfig,
) -> UInt32[ndarray, " k"]:
    """Number of the object of each splat, the one with the largest support first; 0 where it is background."""
    support = np.bincount(parts, weights)
    numbers = np.zeros(len(parts), np.uint32)
    order = np.argsort(parts, kind="stable")
    bounds = np.searchsorted(parts[order], np.arange(len(support) + 1))
    found = 0
    for part in np.argsort(-support, kind="stable").tolist():
        if support[part] < config.min_support:
            break
        rows = order[bounds[part] : bounds[part + 1]]
        if _is_object(places[rows], heights[rows], config):
            found += 1
            numbers[rows] = found
    return numbers


def _is_object(places: Float64[ndarray, "m 3"], heights: Float64[ndarray, " m"], config: ObjectConfig) -> bool:
    low, high = np.quantile(places[:, :2], [0.03, 0.97], axis=0)
    bottom, top = np.quantile(heights, [0.03, 0.97]).tolist()
    width = float(np.max(high - low))
    if width > config.longest or bottom > config.standing or top < config.least_height:
        return False
    return top <= config.tallest or width <= config.pole_width
