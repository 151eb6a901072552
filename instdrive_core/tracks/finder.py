"""Finds what moves in a clip's sweeps: no cuboids, classes or photos are looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.scene.track import Track
from instdrive_core.tracks.abreast import part_abreast
from instdrive_core.tracks.candidates import find_candidates
from instdrive_core.tracks.creepers import find_creepers
from instdrive_core.tracks.fragments import merge_fragments
from instdrive_core.tracks.interpenetration import drop_swapped, join_covered, resolve_overlaps
from instdrive_core.tracks.linking import link_sightings
from instdrive_core.tracks.motion_tests import cut_to_movers
from instdrive_core.tracks.range_images import Votes, count_votes
from instdrive_core.tracks.second_pass import solve_again
from instdrive_core.tracks.solved_thing import SolvedThing, solve_thing
from instdrive_core.tracks.starts import first_guesses
from instdrive_core.tracks.strict_test import is_mover
from instdrive_core.tracks.sweep_clouds import SweepCloud, gather_clouds
from instdrive_core.tracks.written_tracks import convert_to_tracks


@dataclass(frozen=True)
class FoundTracks:
    """What moves in a clip."""

    tracks: tuple[Track, ...]
    """With a pose for each time step of the clip that a track spans."""
    notes: tuple[str, ...]
    """What a user should know."""


def find_tracks(
    clip: Clip, held_out: bool = False, on_stage: Callable[[str], None] = lambda stage: None
) -> FoundTracks:
    """Find the moving objects of a clip in its sweeps.

    Args:
        clip: the clip; only sweeps, times and camera poses are used.
        held_out: whether sweeps of held-out time steps may be used; False for everything that trains.
        on_stage: is told what is being done.

    Raises DataError where a sweep is damaged.
    """
    sweeps = clip.sweeps if held_out else clip.training_sweeps
    if not sweeps:
        return FoundTracks((), ("no LiDAR sweeps: moving objects cannot be found without cuboids",))
    on_stage("reading sweeps")
    clouds, notes = gather_clouds(clip, sweeps)
    if len(clouds) < 3:
        return FoundTracks((), (*notes, f"only {len(clouds)} sweeps: too few to see what moves"))
    on_stage("looking through sweeps")
    votes = vote(clouds)
    things = find_things(clouds, votes, on_stage)
    return FoundTracks(convert_to_tracks(things, clouds, clip), tuple(notes))


def vote(clouds: list[SweepCloud]) -> list[Votes]:
    """How the other sweeps saw the places of each cloud's points."""
    points = []
    for cloud in clouds:
        world = cloud.points.copy()
        world[:, 2] += cloud.heights
        points.append(world)
    return count_votes(points, np.array([cloud.time for cloud in clouds]), [cloud.images for cloud in clouds])


def find_things(
    clouds: list[SweepCloud], votes: list[Votes], on_stage: Callable[[str], None] = lambda stage: None
) -> list[SolvedThing]:
    """Movers with their solved poses."""
    on_stage("following clusters")
    by_sweep = [
        find_candidates(cloud, seen, number) for number, (cloud, seen) in enumerate(zip(clouds, votes, strict=True))
    ]
    chains = [part for chain in link_sightings(by_sweep) for part in cut_to_movers(chain, clouds)]
    on_stage("solving motions")
    solved = [solve_thing(chain.clusters, clouds, first_guesses(chain)) for chain in chains]
    movers = [thing for thing in solved if thing is not None and is_mover(thing, clouds)]
    on_stage("joining fragments")
    whole = merge_fragments(movers, clouds, votes)
    on_stage("looking for what creeps")
    whole = merge_fragments([*whole, *find_creepers(whole, clouds, votes)], clouds, votes)
    on_stage("following on")
    again = join_covered([solve_again(thing, clouds, votes) for thing in whole], clouds, votes)
    joined = [thing for thing in merge_fragments(again, clouds, votes) if is_mover(thing, clouds)]
    kept = drop_swapped(resolve_overlaps(joined, clouds, votes), clouds)
    return [part for thing in kept for part in part_abreast(thing, clouds, votes)]
