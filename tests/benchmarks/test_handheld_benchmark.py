"""Photos around a parked car and of a walk: posed, without points, the same for the same seed."""

import numpy as np
import pytest

from benchmarks.handheld_photos import write_handheld_photos
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip


@pytest.fixture(scope="module")
def orbit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("orbit") / "clip"
    write_handheld_photos(folder, "orbit", 92, 5)
    return folder


def test_an_orbit_looks_at_one_place_from_five_metres(orbit):
    clip = load_clip(str(orbit), ClipOptions(scale=1.0))
    assert len(clip.frames) == 5
    assert clip.points is not None
    assert len(clip.points.points) == 0
    places = np.stack([frame.view.camera.position for frame in clip.frames])
    looks = np.stack([frame.view.camera.world_from_camera[:3, 2] for frame in clip.frames])
    sides = np.eye(3) - looks[:, :, None] * looks[:, None, :]
    middle = np.linalg.solve(sides.sum(axis=0), (sides @ places[:, :, None]).sum(axis=0)[:, 0])
    np.testing.assert_allclose(np.linalg.norm(places - middle, axis=1), 5, atol=0.7)
    assert np.ptp(clip.frames[0].load_image()) > 100


def test_the_same_seed_gives_the_same_photos(orbit, tmp_path):
    write_handheld_photos(tmp_path / "again", "orbit", 92, 5)
    for name in ("transforms.json", "images/003.jpg"):
        assert (tmp_path / "again" / name).read_bytes() == (orbit / name).read_bytes()


def test_a_walk_goes_nine_metres_along_the_road(tmp_path):
    write_handheld_photos(tmp_path / "walk", "walk", 93, 3)
    clip = load_clip(str(tmp_path / "walk"), ClipOptions(scale=1.0))
    places = [frame.view.camera.position for frame in clip.frames]
    assert np.linalg.norm(places[-1] - places[0]) == pytest.approx(9, abs=0.8)
