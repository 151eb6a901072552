"""What points and photos tell of a turning LiDAR."""

from functools import partial

import numpy as np
import pytest

from instdrive_core.datasets.clip import Frame, Sweep, SweepPoints
from instdrive_core.datasets.laser_turn import add_photo_lags, measure_turn
from instdrive_core.errors import DataError
from instdrive_core.scene.camera import Camera, CameraView, look_at

CENTER = np.array([3.0, -2.0, 1.8])
HEADING = np.radians(30)


def go(metres: float, direction: float) -> np.ndarray:
    """The place so far from the LiDAR, level with it."""
    return CENTER + metres * np.array([np.cos(direction), np.sin(direction), 0.0])


def turn_at(time: float, seconds: float = 0.1, clockwise: bool = True, share: float = 1.0) -> SweepPoints:
    """A turn that begins behind the car and ends at `time`; every direction has points near and far."""
    rng = np.random.default_rng(0)
    turned = rng.uniform(0, share, 6000)
    directions = HEADING + np.pi + (-1 if clockwise else 1) * 2 * np.pi * turned
    away = rng.uniform(1, 60, len(turned))
    points = CENTER + np.stack([away * np.cos(directions), away * np.sin(directions), -np.ones(len(turned))], axis=1)
    nothing = np.zeros(len(points), np.uint8)
    times = time - seconds * (share - turned)
    return SweepPoints(points.astype(np.float32), np.zeros(len(points), np.float32), nothing, None, None, times)


def frames_at(step: int) -> list[Frame]:
    """Photos ahead and to the left at one step."""
    frames = []
    for name, turned in (("front", 0.0), ("left", np.pi / 2)):
        camera = Camera(50.0, 50.0, 32.0, 24.0, 64, 48, look_at(CENTER, go(1, HEADING + turned)))
        frames.append(Frame(CameraView(camera, name, step, 0.1 * step), lambda: np.zeros((48, 64, 3), np.uint8)))
    return frames


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_turn_is_measured(clockwise):
    found = measure_turn(turn_at(7.0, clockwise=clockwise), 7.0, CENTER, HEADING)
    assert found is not None
    assert found.turn == pytest.approx(-0.1 if clockwise else 0.1, rel=0.02)
    assert found.began == pytest.approx(-0.1, abs=0.001)
    assert np.cos(found.start - np.pi) > 0.999


def test_what_does_not_turn_tells_nothing():
    whole = turn_at(7.0)
    assert whole.times is not None
    shuffled = np.random.default_rng(1).permutation(whole.times)
    for times in (None, np.full(len(whole.points), 7.0), shuffled, whole.times + 60):
        sweep = SweepPoints(whole.points, whole.intensity, whole.sensor, None, None, times)
        assert measure_turn(sweep, 7.0, CENTER, HEADING) is None
    assert measure_turn(turn_at(7.0, share=0.3), 7.0, CENTER, HEADING) is None  # a LiDAR that looks ahead, to and fro


def test_photos_lag_by_their_own_times():
    frames = [*frames_at(0), *frames_at(1)]
    taken = {"front/00": -0.05, "left/00": -0.07, "front/01": 0.05, "left/01": 0.03}
    sweeps = [Sweep(0, 0.0, partial(turn_at, 0.0))]
    ahead, left = go(20, HEADING), go(20, HEADING + np.pi / 2)
    for step in (0, 1):
        front, side = add_photo_lags(frames, sweeps, taken)[2 * step : 2 * step + 2]
        assert front.view.camera.lag is not None
        assert side.view.camera.lag is not None
        assert front.view.camera.lag.find(ahead) == pytest.approx(0.0, abs=0.002)
        assert side.view.camera.lag.find(left) == pytest.approx(0.005, abs=0.002)  # met at -0.075 s
        assert front.view.camera.lag.find(left) == pytest.approx(0.025, abs=0.002)


def test_photos_stay_as_they_are_where_nothing_tells():
    def fail() -> SweepPoints:
        raise DataError("lidar/00", "is damaged", "Get it again")

    frames = frames_at(0)
    assert add_photo_lags(frames, [], {"front/00": -0.05}) == frames
    assert add_photo_lags(frames, [Sweep(0, 0.0, fail)], {"front/00": -0.05}) == frames
    other_clock = add_photo_lags(frames, [Sweep(0, 0.0, partial(turn_at, 0.0))], {"front/00": 1.6e9})
    assert [frame.view.camera.lag for frame in other_clock] == [None, None]
