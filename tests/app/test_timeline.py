"""Time steps of scenes with and without cameras."""

import numpy as np
import pytest

from instdrive_app.timeline import Timeline
from instdrive_core.scene.camera import Camera, CameraView


def test_a_timeline_without_cameras_takes_the_tracks_moments():
    assert Timeline(()).steps == ()
    assert Timeline(()).find_step(3.0) == 0
    with pytest.raises(ValueError, match="no camera 'front'"):
        Timeline(()).find_nearest_view("front", 0.0)


def test_cameras_that_are_not_triggered_together_share_their_steps():
    eye = Camera(10.0, 10.0, 5.0, 5.0, 10, 10, np.eye(4))
    names = ("front", "left", "right")
    views = [
        CameraView(eye, name, index, 0.1 * index + 0.03 * order)
        for index in range(4)
        for order, name in enumerate(names)
    ]
    timeline = Timeline(views)
    assert timeline.steps == pytest.approx((0.03, 0.13, 0.23, 0.33))
    for name in names:
        view, seen = timeline.find_nearest_view(name, timeline.start), []
        for _ in range(5):
            seen.append(views[view].index)
            view = timeline.find_nearest_view(name, timeline.step_time(views[view].time, 1))
        assert seen == [0, 1, 2, 3, 0], "onwards with the dataset camera, and around the end"
