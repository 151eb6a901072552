"""Streets recorded with other LiDARs, and at other rates."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from written_poses import pose_matrix

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import CONFIG_FILE, HDL32, LIDARS, StreetConfig
from instdrive_core.datasets.synthetic.units import StreetUnits, read_street_config
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.rig import compute_beam_elevations
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import OptionError
from instdrive_core.files.restricted_pickle import read_pickle

CONFIG = StreetConfig(seed=3, steps=2, width=64, height=36, lidar_azimuths=200, lidar=HDL32, rate=5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lidars") / "clip"
    write_street(path, CONFIG)
    return path


def read_pose(folder: Path, step: int) -> np.ndarray:
    return pose_matrix(json.loads((folder / "lidar" / "poses.json").read_text())[step])


def test_a_sweep_has_the_beams_that_were_asked_for(folder: Path) -> None:
    table, pose = read_pickle(folder / "lidar" / "00.pkl.gz"), read_pose(folder, 0)
    local = (np.stack([table[axis] for axis in "xyz"], axis=1) - pose[:3, 3]) @ pose[:3, :3]
    elevations = np.arcsin(local[:, 2] / np.linalg.norm(local, axis=1))
    off = np.abs(elevations[:, None] - compute_beam_elevations(HDL32))
    assert off.min(axis=1).max() < 1e-3
    assert len(np.unique(off.argmin(axis=1))) > 20


def test_beams_are_as_many_as_each_lidar_has() -> None:
    assert [len(np.unique(compute_beam_elevations(name))) for name in LIDARS] == [64, 64, 32, 16]


def test_steps_are_as_far_apart_as_the_rate_says(folder: Path) -> None:
    clip = load_clip(str(folder), ClipOptions(scale=1.0))
    assert clip.sweeps[1].time - clip.sweeps[0].time == pytest.approx(0.2)
    driven = np.linalg.norm(read_pose(folder, 1)[:3, 3] - read_pose(folder, 0)[:3, 3])
    assert driven == pytest.approx(0.2 * 7, rel=0.1)


def test_ten_seconds_are_the_same_street_at_any_rate() -> None:
    twice = replace(StreetConfig(seed=4, steps=200), rate=20)
    assert len(build_street(twice).fixtures) == len(build_street(StreetConfig(seed=4, steps=100)).fixtures)


def test_the_street_is_built_again_with_its_rate(folder: Path, tmp_path: Path) -> None:
    assert read_street_config(folder / CONFIG_FILE) == CONFIG
    faster = tmp_path / CONFIG_FILE
    faster.parent.mkdir()
    faster.write_text(json.dumps(asdict(replace(CONFIG, rate=10))))
    labels = np.asarray(Image.open(folder / "labels" / "front_camera" / "01.png"))
    own, other = (
        (StreetUnits(each).look("front_camera", 1, 64, 36).objects == labels).mean() for each in (folder, tmp_path)
    )
    assert own > other + 0.05


def test_older_streets_say_neither_lidar_nor_rate(folder: Path, tmp_path: Path) -> None:
    entries = json.loads((folder / CONFIG_FILE).read_text())
    del entries["lidar"], entries["rate"]
    (tmp_path / "street.json").write_text(json.dumps(entries))
    assert read_street_config(tmp_path / "street.json") == replace(CONFIG, lidar="pandar64", rate=10)


def test_refuses_lidars_and_rates_it_does_not_know() -> None:
    with pytest.raises(OptionError, match="lidar is 'hesai'; choose one of pandar64, hdl64, hdl32, vlp16"):
        StreetConfig(lidar="hesai")
    with pytest.raises(OptionError, match="rate is 0; choose 1 to 20"):
        StreetConfig(rate=0)
