"""Corners of things that stand are told from those of things that move, also where one camera alone could not tell."""

import numpy as np
import pytest

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.tracks.photos.feature_paths import FeaturePaths
from instdrive_core.tracks.photos.path_verdicts import CameraPaths, judge_paths
from instdrive_core.tracks.photos.standing_ground import measure_camera_height
from instdrive_core.tracks.photos.static_fit import fit_standing_points

COUNT, SPEED = 30, 8.0
TIMES = 0.1 * np.arange(COUNT)
RIDES = 1.6


def cameras():
    places = [np.array([0, SPEED * time, RIDES]) for time in TIMES]
    return [
        Camera(400.0, 400.0, 240.0, 135.0, 480, 270, look_at(place, place + np.array([0, 10.0, -0.3])))
        for place in places
    ]


def street(rng):
    """Points of the ground and of two walls."""
    ground = np.stack([rng.uniform(-6, 6, 900), rng.uniform(0, 60, 900), np.zeros(900)], axis=1)
    walls = np.stack([rng.choice([-6, 6], 900), rng.uniform(0, 80, 900), rng.uniform(0, 5, 900)], axis=1)
    return [lambda time, point=point: point for point in np.concatenate([ground, walls])]


def body(rng, at, count=20):
    """Points of the rear of a car, each as a function of time; `at` is x and y of its middle."""
    offsets = np.stack([rng.uniform(-0.8, 0.8, count), np.zeros(count), rng.uniform(0.3, 1.4, count)], axis=1)
    return [lambda time, offset=offset: np.array([*at(time), 0.0]) + offset for offset in offsets]


def follow(rng, points, noise=0.2, longest=12):
    """Paths of points in view, in pieces of at most `longest` photos, and the number of each path's point."""
    seen, photos, places, starts, owners = cameras(), [], [], [0], []
    for number, point in enumerate(points):
        pixels, depths = zip(
            *(camera.project(point(time)[None]) for camera, time in zip(seen, TIMES, strict=True)), strict=True
        )
        pixels, depths = np.concatenate(pixels), np.concatenate(depths)
        inside = (depths > 1) & (pixels > 0).all(axis=1) & (pixels < [480, 270]).all(axis=1)
        for run in np.split(np.flatnonzero(inside), np.flatnonzero(np.diff(np.flatnonzero(inside)) > 1) + 1):
            for piece in (run[k : k + longest] for k in range(0, len(run), longest)):
                if len(piece) < 3:
                    continue
                photos += piece.tolist()
                places += (pixels[piece] + rng.normal(0, noise, (len(piece), 2))).tolist()
                starts.append(len(photos))
                owners.append(number)
    paths = FeaturePaths(np.array(starts), np.array(photos, np.int32), np.array(places, np.float32))
    return paths, np.array(owners)


@pytest.fixture(scope="module")
def judged():
    """Verdicts of the paths of each thing."""
    rng = np.random.default_rng(3)
    things = {
        "street": street(rng),
        "parked": body(rng, lambda time: (4.0, 25.0)),
        "crossing": body(rng, lambda time: (-4 + 3 * time, 30.0)),
        "ahead at our speed": body(rng, lambda time: (0.6, 12 + SPEED * time)),
        "oncoming, braking": body(rng, lambda time: (-3.0, 34 - 11 * time + 2 * time * time)),
    }
    names = np.repeat(list(things), [len(points) for points in things.values()])
    paths, owners = follow(rng, [point for points in things.values() for point in points])
    verdicts = judge_paths([CameraPaths(cameras(), paths)])[0]
    return {name: verdicts[names[owners] == name] for name in things}


@pytest.mark.parametrize("thing", ["street", "parked"])
def test_what_stands_stands(judged, thing):
    assert (judged[thing] > 0).mean() < 0.03
    assert (judged[thing] < 0).sum() > 10


@pytest.mark.parametrize("thing", ["crossing", "ahead at our speed", "oncoming, braking"])
def test_what_moves_moves(judged, thing):
    """What drives ahead at our speed seems to lie under the ground."""
    says = judged[thing][judged[thing] != 0]
    assert len(says) >= 15
    assert (says > 0).mean() > 0.65


def test_a_standing_point_is_placed_where_it_is():
    rng = np.random.default_rng(0)
    truth = np.array([2.0, 20.0, 0.7])
    paths, _ = follow(rng, [lambda time: truth], noise=0.0)
    fit = fit_standing_points(paths, cameras())
    np.testing.assert_allclose(fit.points[0], truth, atol=0.02)
    assert fit.residuals[0] < 0.01
    held = fit_standing_points(paths, cameras(), np.full(len(paths), 0.2))
    assert held.residuals[0] > 1.0, "five metres away it is not"


def test_the_camera_knows_how_high_it_rides():
    rng = np.random.default_rng(1)
    points = np.array([point(0.0) for point in street(rng)])
    positions = np.stack([camera.position for camera in cameras()])
    noisy = points + rng.normal(0, 0.03, points.shape)
    assert measure_camera_height(positions, noisy) == pytest.approx(RIDES, abs=0.08)
    assert measure_camera_height(positions, points[:20]) is None
