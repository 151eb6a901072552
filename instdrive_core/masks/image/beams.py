"""Where a clip's LiDAR looks: its highest beam, and how far apart beams are, measured on its own points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep

MAX_SWEEPS = 5
"""Sweeps that are looked at, evenly over the drive."""
FAR = 20.0
"""Metres from which on a point's elevation depends little on where exactly the sensor sits on the car."""
USUAL_END = 15.0
"""Elevation in degrees at which the field of view is taken to end where the points do not tell."""
TOP_SHARE = 0.02
"""Share of directions whose highest point may lie above the field's end."""
EDGE, EDGE_SHARE, EDGE_SPREAD = 1.0, 0.05, 1.5
"""The field's end shows where in so large a share of directions the highest point lies within so many degrees of it, at
distances that differ by such a factor. The flat roof of a single wall is all at one distance."""
MIN_POINTS = 200
"""Sweeps with fewer far points say nothing."""
SECTOR = 0.5
"""Degrees of azimuth within which points of different beams lie one above the other."""
SURFACE = 1.1
"""Two such points lie on one surface if their distances differ by less than this factor."""
MIN_GAP = 0.1
"""Degrees below which they are of one beam."""
BIN, MIN_GAPS = 2.0, 20
"""Degrees over which the gaps are summed up, and how many of them count."""


@dataclass(frozen=True)
class BeamField:
    """The upper part of a spinning LiDAR's field of view."""

    highest: float
    """Elevation of the highest beam in degrees; above, the LiDAR is blind."""
    elevations: Float64[ndarray, " k"]
    """Degrees, rising, at which the gaps were measured."""
    gaps: Float64[ndarray, " k"]
    """Degrees from one beam to the next there."""

    def compute_gaps(self, elevation: Float64[ndarray, "h w"]) -> Float64[ndarray, "h w"]:
        """Compute the gap in degrees between the beams around each elevation (degrees)."""
        if not len(self.gaps):
            return np.zeros_like(elevation)
        return np.interp(elevation, self.elevations, self.gaps)

    @property
    def upper_end(self) -> float:
        """Elevation in degrees just below the highest beam, where the beams still tell what is there."""
        return self.highest - (0.5 * float(self.gaps[-1]) if len(self.gaps) else 0.0)


def estimate_sensor_position(clip: Clip, time: float) -> Float64[ndarray, "3"]:
    """Estimate the place of the LiDAR: amid the cameras at the nearest time."""
    views = [frame.view for frame in clip.frames]
    nearest = min((view.time for view in views), key=lambda other: abs(other - time))
    return np.mean([view.camera.position for view in views if view.time == nearest], axis=0)


def estimate_beams(clip: Clip) -> BeamField:
    """Estimate where the first LiDAR of a clip looks, from a few training sweeps; z must point up."""
    sweeps = clip.training_sweeps
    chosen = sorted({*np.linspace(0, len(sweeps) - 1, MAX_SWEEPS).astype(int).tolist()}) if sweeps else []
    offsets = [find_far_offsets(clip, sweeps[row]) for row in chosen]
    return measure_beams([each for each in offsets if len(each) >= MIN_POINTS])


def find_far_offsets(clip: Clip, sweep: Sweep) -> Float32[ndarray, "n 3"]:
    """Find the points of the first LiDAR that lie far from it, relative to its place, in metres."""
    found = sweep.load()
    points = found.points[found.sensor == found.sensor.min()] if len(found.points) else found.points
    offsets = points - estimate_sensor_position(clip, sweep.time).astype(np.float32)
    return offsets[np.linalg.norm(offsets, axis=1) > FAR]


def measure_beams(sweeps: Sequence[Float32[ndarray, "_ 3"]]) -> BeamField:
    """Measure the field of view that sweeps show: points relative to the sensor, in metres."""
    if not sweeps:
        return BeamField(USUAL_END, np.zeros(0), np.zeros(0))
    measured = [_Columns.build(offsets) for offsets in sweeps]
    highest = _find_upper_end(*(np.concatenate([column.find_tops()[k] for column in measured]) for k in range(2)))
    found = [column.find_gaps() for column in measured]
    places, gaps = (np.concatenate([one[k] for one in found]) for k in range(2))
    centers, typical = [], []
    for low in np.arange(-BIN, highest, BIN):
        inside = gaps[(places >= low) & (places < low + BIN)]
        if len(inside) >= MIN_GAPS:
            centers.append(low + BIN / 2)
            typical.append(float(np.median(inside)))
    return BeamField(highest, np.array(centers), np.array(typical))


def _find_upper_end(tops: Float64[ndarray, " d"], distances: Float64[ndarray, " d"]) -> float:
    highest = float(np.quantile(tops, 1 - TOP_SHARE))
    at_edge = distances[np.abs(tops - highest) < EDGE]
    near, far = np.quantile(at_edge, [0.1, 0.9])
    if len(at_edge) >= EDGE_SHARE * len(tops) and far >= EDGE_SPREAD * near:
        return max(highest, 0.0)
    return max(highest, USUAL_END)


@dataclass(frozen=True)
class _Columns:
    """Points in order of direction, then elevation (degrees), and their distances (metres)."""

    sectors: Float64[ndarray, " n"]
    elevations: Float64[ndarray, " n"]
    distances: Float64[ndarray, " n"]

    @staticmethod
    def build(offsets: Float32[ndarray, "n 3"]) -> _Columns:
        exact = offsets.astype(np.float64)
        distances = np.linalg.norm(exact, axis=1)
        elevations = np.degrees(np.arcsin(np.clip(exact[:, 2] / distances, -1, 1)))
        sectors = np.floor(np.degrees(np.arctan2(exact[:, 1], exact[:, 0])) / SECTOR)
        order = np.lexsort((elevations, sectors))
        return _Columns(sectors[order], elevations[order], distances[order])

    def find_tops(self) -> tuple[Float64[ndarray, " d"], Float64[ndarray, " d"]]:
        """Elevation and distance of the highest point in each direction."""
        last = np.flatnonzero(np.diff(self.sectors, append=np.inf))
        return self.elevations[last], self.distances[last]

    def find_gaps(self) -> tuple[Float64[ndarray, " g"], Float64[ndarray, " g"]]:
        """Middles and widths of the gaps between points on one surface, one above the other (degrees)."""
        gap, ratio = np.diff(self.elevations), self.distances[1:] / self.distances[:-1]
        alike = (np.diff(self.sectors) == 0) & (gap > MIN_GAP) & (ratio < SURFACE) & (ratio > 1 / SURFACE)
        return (self.elevations[:-1] + gap / 2)[alike], gap[alike]
