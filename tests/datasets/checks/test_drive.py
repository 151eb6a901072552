"""Faults of drives are told with file, what is wrong and what to do; good drives say nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from post_street import CAMERAS, PostStreet, drop_steps

from instdrive_core.datasets.checks.drive import describe_faults
from instdrive_core.datasets.checks.pose_shift import find_pose_shifts
from instdrive_core.datasets.clip import Clip, ClipOptions, Sweep
from instdrive_core.datasets.registry import load_clip


@pytest.fixture(scope="module")
def clip() -> Clip:
    return PostStreet().build_clip()


def with_times(clip: Clip, times) -> Clip:
    """A clip whose sweeps have other times."""

    def change(sweep: Sweep) -> Sweep:
        return replace(sweep, load=lambda: replace(sweep.load(), times=times(sweep)))

    return replace(clip, sweeps=tuple(change(sweep) for sweep in clip.sweeps))


def test_a_good_drive_has_no_faults(clip):
    assert describe_faults(clip) == []
    every_second = replace(clip, sweeps=clip.sweeps[::2])
    assert describe_faults(every_second) == [], "a slower LiDAR has no gaps"


@pytest.mark.parametrize("lag", [-1, 1])
def test_poses_of_another_step_are_found_in_all_cameras(lag):
    faults = describe_faults(PostStreet(seed=1).build_clip(pose_lag=lag))
    assert len(faults) == 1
    assert "camera/*/poses.json" in faults[0]
    assert f"step {'after' if lag < 0 else 'before'} better" in faults[0]
    assert "Shift it by one entry" in faults[0]


def test_one_cameras_poses_of_another_step_are_found():
    shifts = find_pose_shifts(PostStreet(seed=2).build_clip(pose_lag=1, lagging=CAMERAS[1:]))
    assert [(shift.camera, shift.steps) for shift in shifts] == [("right", -1)]


def test_a_car_that_stands_tells_nothing_of_its_poses():
    assert find_pose_shifts(PostStreet(speed=0.5).build_clip(pose_lag=1)) == []


def test_gaps_are_named_with_their_steps_and_folder(clip):
    faults = describe_faults(drop_steps(clip, (3, 6, 7)))
    photos = [fault for fault in faults if "photo of steps 3, 6–7" in fault]
    assert len(photos) == len(CAMERAS)
    assert str(Path("posts") / "left") in photos[0]
    assert any("no sweep of steps 3, 6–7" in fault for fault in faults)
    only_sweep = replace(clip, sweeps=clip.sweeps[:4] + clip.sweeps[5:])
    assert [fault for fault in describe_faults(only_sweep) if "no sweep of step 4;" in fault]


def test_a_clock_that_jumps_is_told(clip):
    late = tuple(
        replace(frame, view=replace(frame.view, time=frame.view.time + (2.0 if frame.view.index > 5 else 0)))
        for frame in clip.frames
    )
    faults = describe_faults(replace(clip, frames=late, sweeps=()))
    assert len(faults) == 1
    assert "jump by 2.10 s from step 5 to 6, usually by 0.10 s" in faults[0]


def test_sweeps_without_times_or_of_another_clock_are_told(clip):
    missing = describe_faults(with_times(clip, lambda sweep: None))
    assert len(missing) == 1
    assert "the column 't' is missing" in missing[0]
    other = describe_faults(with_times(clip, lambda sweep: np.full(len(sweep.load().points), sweep.time + 1e6)))
    assert len(other) == 1
    assert "1e+06 s off" in other[0]


def test_the_shared_clip_has_no_faults(pandaset_clip):
    loaded = load_clip(str(pandaset_clip), ClipOptions(cameras="3", scale=0.125))
    assert describe_faults(loaded) == []
