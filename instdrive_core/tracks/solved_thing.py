"""A thing whose poses are solved, with the figures that tell whether it truly moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.tracks.boxes import TrackBox, fit_box, looks_like_person
from instdrive_core.tracks.candidates import Cluster
from instdrive_core.tracks.motion_tests import compute_solved_ratio
from instdrive_core.tracks.observations import Observation, observe
from instdrive_core.tracks.pose_graph import Packed, count_occupied_cells, in_object_frame, pack, solve_poses
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import Trajectory

LASTING_CELL, LASTING, OF_PEOPLE = 0.25, 0.1, 0.15
"""Metres along an edge of the cells of a thing's frame, and share of its observations that meet something in one that
is part of the thing; of people, more of them, since all sides of these are met all the time."""


@dataclass(frozen=True, eq=False)
class SolvedThing:
    """A thing that is followed, with its poses."""

    clusters: list[Cluster]
    """In order of time, one a sweep."""
    observations: list[Observation]
    """In order of time."""
    packed: Packed
    trajectory: Trajectory
    ratio: float
    """See `motion_tests.motion_ratio`."""
    core_seen: float = 0.0
    """`seen_through` of the things it was made of, before sweeps in which it stands were added."""

    @property
    def seen_through(self) -> float:
        """Share of its points at whose places others saw through."""
        counts = np.array([len(one.rows) for one in self.clusters])
        own = float(np.average([one.seen_through for one in self.clusters], weights=counts))
        return max(own, self.core_seen)

    @property
    def sweeps(self) -> list[int]:
        """Positions of its sweeps among the clouds."""
        return [one.sweep for one in self.clusters]

    @property
    def point_count(self) -> int:
        """Points of all its clusters."""
        return sum(len(one.rows) for one in self.clusters)

    def local_points(self) -> Float64[ndarray, "n 3"]:
        """Points of all its observations in its own frame."""
        return in_object_frame(self.packed, self.trajectory)

    def lasting_points(self) -> Float64[ndarray, "k 3"]:
        """Points in its own frame at places met in several of its observations: what it brushes past on its way, a post
        or a hedge, lies elsewhere each time."""
        local = self.local_points()
        seen_by = np.repeat(np.arange(len(self.observations)), np.diff(self.packed.starts))
        cells = np.floor(local / LASTING_CELL).astype(np.int64)
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        met = np.unique(np.column_stack([cell, seen_by]), axis=0)[:, 0]
        often = np.bincount(met)[cell] / len(self.observations)
        core = local[often >= OF_PEOPLE]
        if 2 * len(core) > len(local) and looks_like_person(core):
            return core
        return local[often >= LASTING] if np.mean(often >= LASTING) > 0.5 else local

    def box(self, clouds: list[SweepCloud]) -> TrackBox:
        """Its box."""
        return fit_box(self.lasting_points(), self.views(clouds))

    def views(self, clouds: list[SweepCloud]) -> Float64[ndarray, "v 2"]:
        """Where the sensors were in its frame."""
        poses = self.trajectory.poses_at(np.array([one.time for one in self.observations]))
        offset = np.array([clouds[one.sweep].position[:2] for one in self.observations]) - poses[:, :2]
        cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        return np.column_stack(
            [cosine * offset[:, 0] + sine * offset[:, 1], cosine * offset[:, 1] - sine * offset[:, 0]]
        )

    def distance(self, clouds: list[SweepCloud]) -> float:
        """Metres from the sensor where it is nearest."""
        return float(np.linalg.norm(self.views(clouds), axis=1).min())


def solve_thing(
    clusters: list[Cluster], clouds: list[SweepCloud], guesses: list[Trajectory], reaches: tuple[float, ...] = ()
) -> SolvedThing | None:
    """Solve the poses of clusters that are one thing from several first guesses; the one whose points coincide best
    counts. None where too few points lie in a sweep."""
    observations = [found for one in clusters for found in observe(clouds[one.sweep], one.rows, one.sweep)]
    if len(observations) < 3:
        return None
    observations.sort(key=lambda one: one.time)
    packed = pack(observations)
    solved = [solve_poses(packed, guess, reaches) if reaches else solve_poses(packed, guess) for guess in guesses]
    best = min(solved, key=lambda one: count_occupied_cells(packed, one))
    return SolvedThing(clusters, observations, packed, best, compute_solved_ratio(observations, best))
