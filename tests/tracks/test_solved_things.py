"""Solved things: joined, judged, and measured."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import BEAMS, LIDAR_HEIGHT, Body, box_clip, walls

from instdrive_core.tracks import interpenetration
from instdrive_core.tracks.candidates import make_cluster
from instdrive_core.tracks.extension import extend_in_time
from instdrive_core.tracks.finder import find_things, vote
from instdrive_core.tracks.fragments import into_frame, merge_fragments
from instdrive_core.tracks.interpenetration import join_covered, resolve_overlaps
from instdrive_core.tracks.motion_tests import MIN_SWEEPS, carry, motion_ratio
from instdrive_core.tracks.solved_thing import solve_thing
from instdrive_core.tracks.strict_test import STEADY_RATIO, STEADY_SWEEPS, UNSEEN_SWEEPS, why_not
from instdrive_core.tracks.sweep_clouds import gather_clouds


@pytest.fixture(scope="module")
def found():
    """Clouds, votes and things of a street with two cars that drive beside each other's lanes."""
    cars = [Body(lambda time, x=x, y=y: (x + 5.0 * time, y, 0.0)) for x, y in ((9.0, 3.5), (16.0, -3.2))]
    clip = box_clip([*walls(), *cars], ego=lambda time: 4.0 * time)
    clouds, _ = gather_clouds(clip, clip.sweeps)
    votes = vote(clouds)
    return clouds, votes, find_things(clouds, votes)


def test_fragments_are_joined_while_others_begin_in_the_same_sweep(found):
    clouds, votes, things = found
    assert len(things) == 2
    car, other = sorted(things, key=lambda thing: -thing.point_count)
    parts = []
    for is_low in (True, False):
        clusters = []
        for one in car.clusters:
            rows = one.rows[(one.points[:, 2] <= np.percentile(one.points[:, 2], 75)) == is_low]
            clusters.append(make_cluster(clouds[one.sweep], votes[one.sweep].is_seen_through, rows, one.sweep))
        parts.append(solve_thing(clusters, clouds, [car.trajectory]))
    assert parts[0].point_count > other.point_count > parts[1].point_count, "the other one stands between them"
    merged = merge_fragments([parts[0], other, parts[1]], clouds, votes)
    assert len(merged) == 2
    assert max(thing.point_count for thing in merged) == car.point_count


def test_both_ends_of_a_lorry_are_one_and_two_low_things_as_far_apart_are_not():
    lorry = Body(lambda time: (10.0 + 5.0 * time, 4.0, 0.0), (2.4, 8.0, 3.2))
    clip = box_clip([*walls(), lorry], 12, ego=lambda time: 4.0 * time)
    clouds, _ = gather_clouds(clip, clip.sweeps)
    votes = vote(clouds)
    (whole,) = find_things(clouds, votes)
    middle = np.ptp(whole.local_points()[:, 0]) / 2 + whole.local_points()[:, 0].min()

    def merge_ends(top):
        ends = []
        for side in (-1, 1):
            clusters = []
            for one in whole.clusters:
                pose = whole.trajectory.poses_at(np.array([one.time]))[0]
                ahead = into_frame(np.repeat(pose[None], len(one.points), axis=0), one.points[:, :2].astype(float))[
                    :, 0
                ]
                rows = one.rows[(side * (ahead - middle) > 1.6) & (one.points[:, 2] < top)]
                if len(rows) > 4:
                    clusters.append(make_cluster(clouds[one.sweep], votes[one.sweep].is_seen_through, rows, one.sweep))
            ends.append(solve_thing(clusters, clouds, [whole.trajectory]))
        return merge_fragments(ends, clouds, votes)

    assert len(merge_ends(4.0)) == 1
    assert len(merge_ends(1.8)) == 2


def test_what_nobody_saw_through_moves_if_it_is_met_often_and_fits_well(found):
    clouds, _, things = found
    hidden = [replace(one, seen_through=0.0) for one in things[0].clusters]
    assert len(hidden) >= STEADY_SWEEPS
    thing = replace(things[0], clusters=hidden, core_seen=0.0, ratio=STEADY_RATIO)
    clouds = [replace(cloud, images=()) for cloud in clouds]
    assert why_not(thing, clouds) == ""
    assert "seen" in why_not(replace(thing, ratio=STEADY_RATIO + 0.05), clouds)
    assert "seen" in why_not(replace(thing, clusters=hidden[: STEADY_SWEEPS - 1]), clouds)


def test_what_is_taller_than_people_and_as_slim_is_the_end_of_a_wall(found):
    clouds, _, things = found
    thing = things[0]
    local = thing.local_points()

    def squeeze(width, height):
        points = local / np.ptp(local, axis=0) * [width, width, height]
        return why_not(_with_points(thing, points), clouds)

    assert squeeze(0.4, 3.8) == "pole"
    assert squeeze(0.4, 1.7) != "pole"
    assert squeeze(1.8, 3.8) != "pole"
    hidden_below = local / np.ptp(local, axis=0) * [0.4, 0.4, 1.7]
    hidden_below[:, 2] += 2.6 - hidden_below[:, 2].max()
    assert why_not(_with_points(thing, hidden_below), clouds) == "pole"


def test_a_steady_strip_of_several_rows_moves_though_nobody_saw_it_leave_its_places(found):
    clouds, _, things = found
    clouds = [replace(cloud, images=()) for cloud in clouds]
    strip = replace(things[0], ratio=STEADY_RATIO)
    local = strip.local_points()

    def flatten(height):
        return why_not(_with_points(strip, local / np.ptp(local, axis=0) * [4.0, 1.8, height]), clouds)

    assert flatten(0.3) == ""
    assert flatten(0.1).startswith("flat"), "a ring on a roof"


def test_what_is_seen_by_a_quarter_of_the_beams_is_found_again(found):
    clouds, _, things = found
    whole = max(things, key=lambda thing: thing.point_count)
    half = len(clouds) // 2
    near = solve_thing([one for one in whole.clusters if one.sweep >= half], clouds, [whole.trajectory])
    sparse = [_every_fourth_row(cloud) if cloud.index < half else cloud for cloud in clouds]
    _, rows = extend_in_time(near, sparse)
    assert min(rows) <= 1


def _cut(thing, first, last, clouds):
    """A thing as it would be if it had been followed in some sweeps only."""
    return solve_thing([one for one in thing.clusters if first <= one.sweep < last], clouds, [thing.trajectory])


def test_a_car_followed_as_it_comes_and_again_as_it_goes_is_one_thing_to_the_end(found):
    clouds, votes, things = found
    car, count = things[0], len(clouds)
    coming, going = _cut(car, 0, count * 3 // 4, clouds), _cut(car, count // 4, count, clouds)
    for unite in (join_covered, resolve_overlaps):
        (whole,) = unite([coming, going], clouds, votes)
        assert whole.sweeps == car.sweeps
        assert whole.point_count == car.point_count


def test_where_two_in_one_place_cannot_be_joined_the_rest_of_the_smaller_one_is_kept(found, monkeypatch):
    clouds, votes, things = found
    car, count = things[0], len(clouds)
    coming, going = _cut(car, 0, count * 3 // 4, clouds), _cut(car, count // 4, count, clouds)
    monkeypatch.setattr(interpenetration, "join", lambda *_: None)
    parts = join_covered([coming, going], clouds, votes)
    assert sorted(sweep for part in parts for sweep in part.sweeps) == car.sweeps, "each sweep once"
    brief = _cut(car, count * 3 // 4 - 6, count * 3 // 4 + MIN_SWEEPS - 1, clouds)
    assert join_covered([coming, brief], clouds, votes) == [coming], "too few sweeps to be worth keeping"


def test_the_motion_of_all_of_the_time_is_judged_not_that_of_the_first_sweeps():
    rng = np.random.default_rng(0)
    shape = rng.uniform([-2, -0.9, 0.3], [2, 0.9, 1.5], (80, 3)).astype(np.float32)
    places = np.column_stack([0.5 * np.arange(60), np.zeros(60)])
    parts = [shape + np.array([*place, 0]) for place in places]
    steady = motion_ratio(parts, places)
    assert steady < 0.05
    for first in range(20):  # far off still: each sweep meets another bit of it
        parts[first] = parts[first][[4 * first]] + np.array([[0, 0, 0.4 * (first % 3)]])
    assert motion_ratio(parts, places) < 0.5


def test_what_nobody_saw_through_and_few_sweeps_met_is_no_mover(found):
    clouds, _, things = found
    clouds = [replace(cloud, images=()) for cloud in clouds]

    def judge(count):
        clusters = [replace(one, seen_through=0.0) for one in things[0].clusters[:count]]
        apart = [replace(cloud, position=cloud.position + np.array([0, 60, 0])) for cloud in clouds]
        return why_not(replace(things[0], clusters=clusters, core_seen=0.0), apart)

    assert judge(UNSEEN_SWEEPS) == ""
    assert judge(UNSEEN_SWEEPS - 1).startswith("never seen through")


def _every_fourth_row(cloud):
    distance = np.linalg.norm(cloud.points[:, :2] - cloud.position[:2], axis=1)
    degrees = np.degrees(np.arctan2(cloud.points[:, 2] - LIDAR_HEIGHT, distance))
    row = np.round((degrees - BEAMS[0]) / (BEAMS[1] - BEAMS[0]))
    kept = row % 4 == 0
    names = ("points", "heights", "distance", "sensor", "times")
    return replace(cloud, **{name: getattr(cloud, name)[kept] for name in names})


def _with_points(thing, points):
    class Squeezed(type(thing)):
        def local_points(self):
            return points

    return Squeezed(thing.clusters, thing.observations, thing.packed, thing.trajectory, thing.ratio, thing.core_seen)


def test_a_post_brushed_past_is_no_part_of_the_thing(found):
    clouds, _, things = found
    thing = things[0]
    clusters = list(thing.clusters)
    middle = len(clusters) // 2
    one = clusters[middle]
    pose = thing.trajectory.poses_at(np.array([one.time]))[0]
    post = carry(np.array([[3.6, 0.0, z] for z in np.arange(0.5, 3.5, 0.1)]), np.zeros(2), 0.0, pose[:2], pose[2])
    cloud = clouds[one.sweep]
    rows = np.concatenate([one.rows, np.arange(len(post)) + len(cloud.points)])
    grown = replace(
        cloud,
        points=np.concatenate([cloud.points, post]).astype(np.float32),
        **{name: np.concatenate([getattr(cloud, name), getattr(cloud, name)[one.rows[:1]].repeat(len(post))])
           for name in ("heights", "distance", "sensor", "times")},
    )  # fmt: skip
    everywhere = [*clouds[: one.sweep], grown, *clouds[one.sweep + 1 :]]
    clusters[middle] = make_cluster(grown, np.ones(len(grown.points), bool), rows, one.sweep)
    brushed = solve_thing(clusters, everywhere, [thing.trajectory])
    assert np.ptp(brushed.local_points()[:, 2]) > 2.5
    assert brushed.box(everywhere).height < 2.0
