"""What leads chains astray is left out of them, and the recording car's own parts are told from its neighbours."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.tracks.candidates import Cluster
from instdrive_core.tracks.linking import Chain, part_at_slivers
from instdrive_core.tracks.motion_tests import cut_to_movers, may_move, moves_with_ego
from instdrive_core.tracks.sweep_clouds import SweepCloud


def chain_of(counts):
    clusters = []
    for sweep, count in enumerate(counts):
        points = np.zeros((count, 3), np.float32)
        clusters.append(Cluster(sweep, np.arange(count), points, 0.1 * sweep, np.zeros(3), np.ones(3), 1.0))
    return Chain(clusters, [np.array([step, 0.0]) for step in range(1, len(counts))])


def sweeps_of(chains):
    return [[one.sweep for one in chain.clusters] for chain in chains]


def test_slivers_are_left_out_and_the_way_stays_whole():
    (trimmed,) = part_at_slivers(chain_of([200, 210, 5, 220, 190, 205]))
    assert sweeps_of([trimmed]) == [[0, 1, 3, 4, 5]]
    np.testing.assert_allclose(trimmed.shifts, [[1, 0], [5, 0], [4, 0], [5, 0]])


def test_what_is_seen_less_and_less_stays():
    chain = chain_of([200, 170, 140, 120, 100, 80, 65])
    assert part_at_slivers(chain) == [chain]


def test_lasting_slivers_are_a_chain_for_themselves():
    parts = part_at_slivers(chain_of([200] * 12 + [10] * 12 + [220] * 8))
    assert sweeps_of(parts) == [[*range(12)], [*range(12, 24)], [*range(24, 32)]]
    assert [len(part.shifts) for part in parts] == [11, 11, 7]
    np.testing.assert_allclose(parts[2].shifts[0], [25, 0])


def test_slivers_before_the_thing_was_seen_lead_it_nowhere():
    assert sweeps_of(part_at_slivers(chain_of([12] * 5 + [240] * 20))) == [[*range(5, 25)]]


def drive(turning):
    headings = np.linspace(0, 1.2, 30) if turning else np.zeros(30)
    steps = 0.3 * np.stack([np.cos(headings), np.sin(headings), np.zeros(30)], axis=1)
    return [cloud_at(place, 0.1 * number) for number, place in enumerate(np.cumsum(steps, axis=0))], headings


def cloud_at(place, time):
    points, none = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    return SweepCloud(0, time, place, points, none, none, none.astype(np.uint8), np.zeros(0), np.zeros(72), ())


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize(("along", "left", "is_part"), [(-2.5, 0.6, True), (2.0, -3.4, False), (12.0, 0.0, False)])
def test_only_what_is_fixed_to_the_recording_car_is_a_part_of_it(turning, along, left, is_part):
    clouds, headings = drive(turning)
    ego = np.array([cloud.position[:2] for cloud in clouds])
    forward, side = (
        np.stack([np.cos(headings), np.sin(headings)], 1),
        np.stack([-np.sin(headings), np.cos(headings)], 1),
    )
    places = ego + along * forward + left * side
    assert moves_with_ego(places, clouds, list(range(30))) == is_part


def test_what_drives_close_behind_and_falls_back_is_no_part():
    clouds, _ = drive(False)
    places = np.array([cloud.position[:2] for cloud in clouds]) - [[3.0 + 0.06 * step, 0.0] for step in range(30)]
    assert not moves_with_ego(places, clouds, list(range(30)))


def walker_at(place, sweep):
    across, up = np.meshgrid(np.arange(-0.3, 0.31, 0.1), np.arange(0.3, 1.7, 0.2))
    points = np.column_stack([across.ravel(), np.zeros(across.size), up.ravel()]).astype(np.float32)
    points[:, :2] += np.float32(place)
    low, high = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
    return Cluster(sweep, np.arange(len(points)), points, 0.1 * sweep, low, high, 1.0)


def test_who_turns_back_is_cut_where_he_turns():
    clouds, _ = drive(False)
    way = np.r_[np.arange(0, 2.1, 0.14), np.arange(2.1, 0.0, -0.14)]
    clusters = [walker_at((place, 20.0), sweep) for sweep, place in enumerate(way)]
    whole = Chain(clusters, [np.array([step, 0.0]) for step in np.diff(way)])
    there, back = cut_to_movers(whole, clouds)
    assert [len(there.clusters), len(back.clusters)] == pytest.approx([15, 15], abs=1)
    assert np.sum(there.shifts, axis=0)[0] > 1.8
    assert np.sum(back.shifts, axis=0)[0] < -1.6


def test_two_who_meet_and_were_taken_for_each_other_are_cut_however_far_they_went():
    clouds, _ = drive(False)
    way = 0.14 * np.r_[0:19, 19:8:-1]
    whole = chain_along(way, 0.1)
    assert may_move(whole, clouds), "it would pass for one"
    assert [len(part.clusters) for part in cut_to_movers(whole, clouds)] == pytest.approx([19, 11], abs=1)


def test_who_has_the_time_to_turn_round_is_not_cut():
    clouds, _ = drive(False)
    way = 0.14 * np.r_[0:19, 19:8:-1]
    (whole,) = cut_to_movers(chain_along(way, 0.2), clouds)
    assert len(whole.clusters) == len(way)


def chain_along(way, period):
    clusters = [replace(walker_at((x, 20.0), sweep), time=period * sweep) for sweep, x in enumerate(way)]
    return Chain(clusters, [np.array([step, 0.0]) for step in np.diff(way)])


def test_what_stands_is_no_mover_however_it_is_cut():
    clouds, _ = drive(False)
    chain = Chain([walker_at((0.0, 20.0), sweep) for sweep in range(30)], [np.zeros(2)] * 29)
    assert cut_to_movers(chain, clouds) == []


def test_what_jumped_from_a_post_to_a_walker_is_cut_at_the_jump():
    clouds, _ = drive(False)
    way = np.r_[[3.0, 3.05], 0.14 * np.arange(12)]
    whole = chain_along(way, 0.1)
    assert not may_move(whole, clouds), "both together go nowhere"
    (walker,) = cut_to_movers(whole, clouds)
    assert sweeps_of([walker]) == [[*range(2, 14)]]
    assert len(walker.shifts) == 11
