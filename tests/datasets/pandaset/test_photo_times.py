"""What the times of PandaSet's photos and points tell: when a photo shows what the LiDAR met."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small_clip import LIDAR_STEPS, START, offset, write_json, write_small_clip, write_table

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.clip_recordings import record_clip
from instdrive_core.datasets.pandaset.write import write_pandaset
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.scene.camera import PhotoLag


@pytest.fixture
def root(tmp_path):
    return write_small_clip(tmp_path / "clip")


def load(root, **options):
    return load_clip(str(root), ClipOptions(cameras="front_camera,back_camera", **options))


def turning_sweep(start, seconds):
    """A table of points that a LiDAR met clockwise from behind the car, in the turn before `seconds`."""
    turned = (np.arange(2000) + 0.5) / 2000
    directions = -np.pi / 2 - 2 * np.pi * turned
    points = start + 20 * np.stack([np.cos(directions), np.sin(directions), 0 * turned], axis=1)
    table = {name: points[:, column] for column, name in enumerate("xyz")}
    return table | {"i": np.zeros(2000), "t": seconds - 0.1 * (1 - turned), "d": np.zeros(2000, int)}


def test_photos_show_things_later_or_earlier_than_the_lidar_met_them(root, tmp_path):
    """The lag is in the photos' and the points' times; written as another sequence it is the same."""
    assert all(frame.view.camera.lag is None for frame in load(root).frames)  # its points are of one instant
    stamps = json.loads((root / "meta" / "timestamps.json").read_text())
    for step in LIDAR_STEPS:
        write_table(root / "lidar" / f"{step:02d}.pkl.gz", turning_sweep(START + offset(0, step, 0), stamps[step]))
    for name, taken in (("front_camera", -0.05), ("back_camera", -0.1)):
        write_json(root / "camera" / name / "timestamps.json", [stamp + taken for stamp in stamps])
    again = write_pandaset(record_clip(load(root, scale=1.0)), tmp_path / "again")
    for clip in (load(root, scale=1.0), load(again, scale=1.0)):
        at_last_step = [frame.view for frame in clip.frames][-2:]
        front, back = (view.camera.lag for view in at_last_step)
        place = START + offset(0, 30, 0) - clip.origin
        assert front.find(place) == pytest.approx(0.0, abs=0.001)
        assert back.find(place) == pytest.approx(-0.05, abs=0.001)
        assert front.find(START + offset(-30, 6, 0) - clip.origin) == pytest.approx(0.025, abs=0.001)


def test_scenes_that_were_trained_without_lags_are_drawn_without(root):
    clip = load(root)
    lag = PhotoLag.look_from(np.zeros(3), 0.3, -0.1, -0.1, -0.05)
    known = [replace(frame.view, camera=replace(frame.view.camera, lag=lag)) for frame in clip.frames]
    lagging = clip.with_cameras(known)
    assert {frame.view.camera.lag for frame in lagging.frames} == {lag}
    assert {frame.view.camera.lag for frame in lagging.with_cameras([frame.view for frame in clip.frames]).frames} == {
        None
    }


def test_photo_times_that_are_no_numbers_are_told(root):
    write_json(root / "camera" / "front_camera" / "timestamps.json", ["soon"])
    with pytest.raises(DataError, match=r"timestamps\.json"):
        load(root)
