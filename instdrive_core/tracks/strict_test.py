"""The strict test: which solved things are movers. What stands still and is seen in part now and then moves, too, to a
tracker; such ghosts explain their points badly, are never seen through, or measure like nothing that drives."""

from __future__ import annotations

import numpy as np

from instdrive_core.tracks.boxes import PERSON_HEIGHTS
from instdrive_core.tracks.motion_tests import moves_with_ego
from instdrive_core.tracks.solved_thing import SolvedThing
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.vacated import may_be_ring, vacates

MAX_RATIO, SURE_SEEN, SURE_RATIO = 0.5, 0.5, 0.8
"""Greatest `motion_ratio`; what was seen through at so many of its places may have the greater one: slow things overlap
themselves a metre on. What was seen to leave its places and goes less than twice its size may have any."""
MIN_WAY, PROVED_WAY = 0.9, 0.6
"""Metres between its two farthest places, and between those of a thing that was seen to leave its places."""
SEEN = 0.1
"""Share of points at places seen through below which more is asked of a thing."""
FEW_SEEN, SURE_MOTION = 0.02, 0.35
"""What walks along a wall is seldom seen through: so many points suffice if no more of its distances are left."""
UNSEEN_WAY, UNSEEN_SWEEPS = 5.0, 8
"""Metres that a thing must travel whose places nobody saw through, and sweeps that meet it: far edges of parked cars
creep less, and what others uncover bit by bit is brief."""
STEADY_SWEEPS, STEADY_RATIO = 12, 0.25
"""Sweeps that meet a thing whose places nobody saw through, and greatest `motion_ratio`, from which on it moves all the
same: in a jam the next car fills each gap, and behind a row of cars no beam goes on. Ghosts are brief, or fit badly."""
NEAR = 30.0
"""Metres within which a mover is seen through, as beams are dense there."""
FLAT, FLAT_REACH = 0.35, 40.0
"""Metres that a thing nearer than so many metres rises from its lowest to its highest point at least, unless it was
seen to leave its places: others may leave but a strip of it to be seen."""
ROWS = 0.2
"""Metres that a strip which nobody saw leave its places rises at least: more than a ring on a roof does."""
THIN = 0.3
"""Metres along and across: thinner things are posts and edges unless others saw through their places."""
STOUT = 0.8
"""Metres along or across that what is taller than people measures: else it is a post, or the end of a wall that others
uncover."""
MAX_LENGTH, MAX_WIDTH = 19.0, 3.6
"""Metres of the largest vehicle."""
MAX_TURN = 1.2
"""Radians per second."""


def is_mover(thing: SolvedThing, clouds: list[SweepCloud]) -> bool:
    """Whether a solved thing truly moves."""
    return why_not(thing, clouds) == ""


def why_not(thing: SolvedThing, clouds: list[SweepCloud]) -> str:
    """Why a solved thing is no mover; empty where it is one."""
    way, seen, distance = thing.trajectory.farthest_way(), thing.seen_through, thing.distance(clouds)
    local = thing.local_points()
    extent = np.percentile(local, 97, axis=0) - np.percentile(local, 3, axis=0)
    is_proved = way >= PROVED_WAY and vacates(thing, clouds)
    if way < MIN_WAY and not is_proved:
        return f"way {way:.2f}"
    size = float(extent[:2].max())
    overlaps = is_proved and way < 2 * size
    if thing.ratio > (SURE_RATIO if seen > SURE_SEEN else MAX_RATIO) and not overlaps:
        return f"ratio {thing.ratio:.2f}"
    if extent[0] > MAX_LENGTH or extent[1] > MAX_WIDTH:
        return f"extent {extent[0]:.1f} {extent[1]:.1f}"
    places = thing.trajectory.poses_at(np.array([one.time for one in thing.observations]))[:, :2]
    if moves_with_ego(places, clouds, [one.sweep for one in thing.observations]):
        return "ego"
    walks_by = seen > FEW_SEEN and thing.ratio < SURE_MOTION and way > 3 * size
    is_long = len(thing.clusters) >= STEADY_SWEEPS
    is_steady = is_proved or (is_long and thing.ratio <= STEADY_RATIO and not may_be_ring(thing, clouds))
    if seen < SEEN and not is_steady and ((distance < NEAR and not walks_by) or way < 2 * size):
        return f"seen {seen:.2f} at {distance:.0f} way {way:.1f}"
    if seen < FEW_SEEN and not is_steady and (way < UNSEEN_WAY or len(thing.clusters) < UNSEEN_SWEEPS):
        return f"never seen through, way {way:.1f} in {len(thing.clusters)} sweeps"
    is_strip = is_long and thing.ratio <= MAX_RATIO and (is_proved or (is_steady and extent[2] >= ROWS))
    if extent[2] < FLAT and distance < FLAT_REACH and not is_strip:
        return f"flat {extent[2]:.2f}"
    if size < STOUT and np.percentile(local[:, 2], 97) > PERSON_HEIGHTS[1]:
        return "pole"
    if size < THIN and seen < 3 * SEEN:
        return "thin"
    return ""
