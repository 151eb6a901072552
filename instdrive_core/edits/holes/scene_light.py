"""How deep shadows are in a scene and where its sun stands, told by what stands on its ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.cast_shadow import LIT_QUANTILE, SHADOW_REACH, find_cast_shadow
from instdrive_core.edits.holes.ground_cells import find_covered_cells, grow_cells
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import build_ground_map, find_solid_cells
from instdrive_core.edits.holes.holes import build_ground_grid
from instdrive_core.edits.holes.shade import SceneLight, find_thrown_cells
from instdrive_core.edits.holes.surroundings import find_surroundings
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.instances.vehicles import is_vehicle
from instdrive_core.scene.selection import Flag

MOST_THINGS = 8
"""Things that are looked at."""
_RIM = 0.4
"""Metres around a thing in which its contact shadow lies."""
_REACH = 3.0
"""Metres around it in which the sun's shadow is looked for."""
_RIM_SHARE = 0.45
"""Mean darkness of a rim that wide, relative to that below the thing, with edges as soft as those of `SceneLight`."""
_LIMITS = (0.45, 0.7)
"""Least and most share of the light that is believed to be missing below a thing."""
_LENGTHS = (0.25, 0.5, 0.75, 1.0, 1.4, 1.9, 2.5)
"""Metres of shadow for each metre of height that are tried."""
_AZIMUTHS = 32
_MIN_OVERLAP = 0.45
"""Intersection over union with dark ground from which a sun is believed."""
_MIN_CELLS = 25


@dataclass(frozen=True)
class _Trace:
    """The ground around one thing."""

    grid: GroundGrid
    points: Float64[ndarray, "k 3"]
    """Solid splats in the grid's own axes, metres; z above the ground."""
    visible: Bool[ndarray, "a b"]
    """Free ground near the thing, of which it is known whether it is dark."""
    dark: Bool[ndarray, "a b"]
    rim: float
    """Brightness close around the thing relative to ground in the light; 1 where nothing is known."""
    shaded: float
    """Brightness of dark ground relative to ground in the light."""


def estimate_light(document: Document, time: float) -> SceneLight:
    """Estimate from parked vehicles, or other compact things where there are none; `SceneLight()` where nothing tells.

    `time` (seconds) says where moving ones are. A second or two: give a frozen copy to do this on another thread.
    """
    traces = [trace for number in _choose_things(document) if (trace := _trace(document, number, time)) is not None]
    rims = [trace.rim for trace in traces if trace.rim < 1]
    usual = SceneLight()
    if not rims:
        return usual
    contact = float(np.clip((1 - np.median(rims)) / _RIM_SHARE, *_LIMITS))
    telling = [trace for trace in traces if np.count_nonzero(trace.dark) >= _MIN_CELLS]
    sun, overlap = _find_sun(telling)
    if overlap < _MIN_OVERLAP:
        return SceneLight(contact)
    share = float(np.clip(1 - np.median([trace.shaded for trace in telling]), 0.1, _LIMITS[1]))
    return SceneLight(contact, sun, share)


def _choose_things(document: Document) -> list[int]:
    """IDs of large compact things that stand where they were trained, vehicles first."""
    things = [each for each in document.scene.table.instances.values() if is_compact(each) and not each.node]
    things.sort(key=lambda each: (not is_vehicle(each), -each.count))
    return [each.id for each in things[:MOST_THINGS]]


def _trace(document: Document, number: int, time: float) -> _Trace | None:
    rows = document.find_rows((number,))
    alive = rows[(document.state.flags[rows] & (Flag.DELETED | Flag.HIDDEN)) == 0]
    if document.transforms.indices[rows].any() or len(alive) < len(rows) / 2:
        return None
    found = find_surroundings(document, [(number, alive)], time)
    grid = build_ground_grid(found) if found is not None else None
    if found is None or grid is None:
        return None
    ground = build_ground_map(grid, found.around)
    under, others = find_covered_cells(found.deleted, grid), find_covered_cells(found.others, grid)
    free = find_solid_cells(ground) & ~ground.obstructed & ~under & ~grow_cells(others, grid.size, _RIM)
    clean = free & ~grow_cells(under, grid.size, _REACH)
    rim = free & grow_cells(under, grid.size, _RIM)
    if min(np.count_nonzero(clean), np.count_nonzero(rim)) < _MIN_CELLS or not under.any():
        return None
    brightness = ground.color.mean(axis=2)
    lit = max(float(np.quantile(brightness[clean], LIT_QUANTILE)), 1e-3)
    visible = free & grow_cells(under, grid.size, SHADOW_REACH)
    dark = visible & find_cast_shadow(ground, clean, under, under)
    shaded = float(np.median(brightness[dark]) / lit) if dark.any() else 1.0
    plain = rim & ~grow_cells(dark, grid.size, grid.size)
    edge = float(np.median(brightness[plain])) / lit if np.count_nonzero(plain) >= _MIN_CELLS else 1.0
    points = found.deleted[0].points
    local = np.c_[(points[:, :2] - np.array(grid.corner)) @ grid.axes.T, grid.compute_heights(points)]
    return _Trace(grid, local, visible, dark, min(edge, 1.0), shaded)


def _find_sun(traces: list[_Trace]) -> tuple[tuple[float, float], float]:
    """The sun whose shadows agree best with dark ground, and their mean overlap with it."""
    best, found = 0.0, (0.0, 0.0)
    for azimuth in np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS):
        for length in _LENGTHS:
            sun = np.array([np.cos(azimuth), np.sin(azimuth)]) * length
            overlaps = [_measure_overlap(trace, sun) for trace in traces]
            if overlaps and np.mean(overlaps) > best:
                best, found = float(np.mean(overlaps)), (float(sun[0]), float(sun[1]))
    return found, best


def _measure_overlap(trace: _Trace, sun: Float64[ndarray, "2"]) -> float:
    """Intersection over union of dark ground and the shadow that this sun throws (metres along the world's x and y)."""
    turned = trace.grid.axes @ sun
    shape, size = np.array(trace.visible.shape), trace.grid.size
    thrown = find_thrown_cells(trace.points, (turned[0], turned[1]), np.zeros(2), shape, size) & trace.visible
    either = np.count_nonzero(thrown | trace.dark)
    return np.count_nonzero(thrown & trace.dark) / either if either else 0.0
