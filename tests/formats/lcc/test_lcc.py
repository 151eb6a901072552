"""The .lcc: finest level, environment, harmonics, and files that do not fit each other."""

import json

import numpy as np
import pytest

from instdrive_core.errors import DataError
from instdrive_core.formats.lcc.meta import DATA, ENVIRONMENT, HARMONICS, HARMONICS_RECORD, INDEX, RECORD
from instdrive_core.formats.lcc.sample_files import build_lcc, write_lcc
from instdrive_core.formats.lcc.scenes import read_lcc
from instdrive_core.formats.registry import open_scene

SQUARES = (30, 20)
FINEST = np.r_[0:30, 45:65]
"""Rows of the data: each square's finest level precedes its coarser one."""


def build(**options):
    return build_lcc(np.random.default_rng(1), SQUARES, **options)


def save(folder, content):
    return write_lcc(folder / "street", content)


def test_the_finest_level_is_read(tmp_path):
    content = build()
    stored = np.frombuffer(content[DATA], RECORD)[FINEST]
    folder = save(tmp_path, content)
    found = open_scene(folder).gaussians
    assert open_scene(folder / "meta.lcc").gaussians.means.tobytes() == found.means.tobytes()
    np.testing.assert_array_equal(found.means, stored["position"])
    low, high = np.array([1e-4, 2e-4, 3e-4]), np.array([0.5, 0.6, 0.7])
    np.testing.assert_allclose(np.exp(found.log_scales), low + stored["scale"] / 65535 * (high - low), rtol=1e-5)
    words = np.frombuffer(content[HARMONICS], HARMONICS_RECORD)["words"][FINEST]
    np.testing.assert_allclose(found.sh_rest[:, :, 1], -1.1 + 2.5 * (words >> 11 & 1023) / 1023, atol=1e-5)


def test_rotations_are_put_together_again(tmp_path):
    """One whose largest part is x: its word names 0, and y, z, w follow."""
    content = build(harmonics=False)
    quat = np.array([0.8, -0.2, 0.4, 0.4])  # xyzw
    steps = np.rint((quat[1:] + np.sqrt(0.5)) / np.sqrt(2) * 1023).astype(np.uint32)
    records = np.frombuffer(content[DATA], RECORD).copy()
    records["rotation"] = steps[0] | steps[1] << 10 | steps[2] << 20
    found = read_lcc(save(tmp_path, content | {DATA: records.tobytes()})).gaussians
    assert found.sh_rest.shape == (50, 0, 3)
    np.testing.assert_allclose(found.quats, np.tile(quat[[3, 0, 1, 2]], (50, 1)), atol=0.002)


def test_the_environment_comes_last_with_its_own_range(tmp_path):
    without = read_lcc(save(tmp_path / "a", build()))
    scene = read_lcc(save(tmp_path / "b", build(environment=7)))
    assert (len(without), len(scene)) == (50, 57)
    assert (np.exp(scene.gaussians.log_scales[50:]) >= 0.999).all()
    assert (np.exp(scene.gaussians.log_scales[:50]) < 0.71).all()


def edit_meta(content, **changes):
    return content | {"meta.lcc": json.dumps(json.loads(content["meta.lcc"]) | changes).encode()}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"totalLevel": 0}, "'totalLevel' is 0"),
        ({"totalLevel": 3}, "no whole number of records"),
        ({"splats": [49, 25]}, "promises 49"),
        ({"attributes": {}}, "is a dict, not a list"),
        ({"attributes": []}, "no attribute is called 'scale'"),
        ({"attributes": [{"name": "scale", "min": [0, 0, 0]}]}, r"'scale\.max' is missing"),
        ({"attributes": [{"name": "scale", "min": [0, 0], "max": [1, 1, 1]}]}, "not three numbers"),
        ({"attributes": [{"name": "scale", "min": [-1, 0, 0], "max": [1, 1, 1]}]}, "below 0"),
        ({"attributes": [{"name": "scale", "min": [0, 0, 0], "max": [1, 1e300, 1]}]}, "above"),
    ],
)
def test_a_meta_file_that_lies_is_refused(tmp_path, changes, said):
    with pytest.raises(DataError, match=said):
        read_lcc(save(tmp_path, edit_meta(build(), **changes)))


def test_files_that_are_too_short_are_refused(tmp_path):
    content = build(environment=3)
    for name, said in ((DATA, "its splats need"), (HARMONICS, "its splats need"), (ENVIRONMENT, "no whole number")):
        with pytest.raises(DataError, match=said):
            read_lcc(save(tmp_path / name, content | {name: content[name][:-40]}))


def test_an_index_that_points_elsewhere_is_refused(tmp_path):
    content = build()
    index = bytearray(content[INDEX])
    index[8:16] = (16).to_bytes(8, "little")
    with pytest.raises(DataError, match="from byte 16"):
        read_lcc(save(tmp_path / "a", content | {INDEX: bytes(index)}))
    index[8:16] = (RECORD.itemsize * 10**9).to_bytes(8, "little")
    with pytest.raises(DataError, match="its splats need"):
        read_lcc(save(tmp_path / "b", content | {INDEX: bytes(index)}))


def test_two_scenes_in_one_folder_have_to_be_named(tmp_path):
    folder = save(tmp_path, build())
    (folder / "other.lcc").write_bytes((folder / "meta.lcc").read_bytes())
    with pytest.raises(DataError, match="street"):
        open_scene(folder)
    assert len(open_scene(folder / "other.lcc")) == 50
