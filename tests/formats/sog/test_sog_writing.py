"""The SOG writer: promised bounds on scenes of any spread, and palettes that many splats share."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from quantised_cases import hard_gaussians, rotation_angles
from random_scene import random_gaussians
from scipy.cluster.vq import kmeans2

from instdrive_core.errors import DataError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.sog import clusters
from instdrive_core.formats.sog.palettes import choose_codebook, choose_palette, find_codes
from instdrive_core.formats.sog.writing import LOG_SCALE_LIMITS, bound_position_error, order_for_sog
from instdrive_core.scene.scene import scene_from_gaussians


def half_gaps(values):
    """Half the widest gap of the codebook that is chosen for some values."""
    return np.diff(choose_codebook(values.ravel())).max() / 2 * 1.0001 + 1e-6 * np.abs(values)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(hard_gaussians())
def test_scenes_come_back_within_the_promised_bounds(tmp_path, gaussians):
    save_scene(tmp_path / "a.sog", scene_from_gaussians(gaussians))
    found = open_scene(tmp_path / "a.sog").gaussians
    wanted = gaussians.select(order_for_sog(gaussians.means))
    assert (np.abs(found.means - wanted.means.astype(np.float64)) <= bound_position_error(wanted.means)).all()
    scales = np.clip(wanted.log_scales, *LOG_SCALE_LIMITS)
    assert (np.abs(found.log_scales - scales) <= half_gaps(scales)).all()
    assert (np.abs(found.sh_dc - wanted.sh_dc) <= half_gaps(wanted.sh_dc)).all()
    if wanted.sh_degree:
        assert (np.abs(found.sh_rest - wanted.sh_rest) <= half_gaps(wanted.sh_rest)).all()
    assert np.abs(found.opacities - wanted.opacities).max() <= 1 / 510 + 1e-5
    assert rotation_angles(found.quats, wanted.quats).max() < 1.1


def test_many_rows_share_a_palette():
    rng = np.random.default_rng(1)
    kinds = rng.normal(size=(300, 9)).astype(np.float32)
    rows = (kinds[rng.integers(0, 300, 5000)] + rng.normal(0, 0.01, (5000, 9))).astype(np.float32)
    palette, labels = choose_palette(rows, 2000)
    assert len(palette) <= 2000
    assert np.sqrt(np.mean((palette[labels] - rows) ** 2)) < 0.05


def test_rows_that_are_alike_take_one_entry():
    rows = np.zeros((5000, 9), np.float32)
    rows[:30] = np.random.default_rng(4).normal(size=(30, 9))
    palette, labels = choose_palette(rows, 2000)
    assert len(palette) == 31
    np.testing.assert_array_equal(palette[labels], rows)


def test_clusters_are_those_of_another_kmeans():
    rng = np.random.default_rng(6)
    rows = (rng.normal(size=(8, 9))[rng.integers(0, 8, 400)] + rng.normal(0, 0.2, (400, 9))).astype(np.float32)
    centers, found = clusters.cluster_rows(rows, rows[:20])
    wanted, _ = kmeans2(rows, rows[:20], iter=clusters.ROUNDS, minit="matrix", missing="warn")
    np.testing.assert_allclose(centers, wanted, atol=1e-5)
    np.testing.assert_array_equal(found, np.linalg.norm(rows[:, None] - centers, axis=2).argmin(axis=1))


@pytest.mark.parametrize("hashes_meet", [False, True])
def test_equal_rows_are_found(monkeypatch, hashes_meet):
    if hashes_meet:
        monkeypatch.setattr(clusters, "_hash_rows", lambda bits: np.zeros(len(bits), np.uint64))
    rows = np.random.default_rng(7).integers(0, 3, (900, 4)).astype(np.float32)
    first, place = clusters.find_different_rows(rows)
    np.testing.assert_array_equal(rows[first][place], rows)
    assert len(first) == len(np.unique(rows, axis=0))


def test_the_ends_of_a_codebook_are_kept():
    values = np.append(np.random.default_rng(2).normal(size=3000), [40.0, -7.0]).astype(np.float32)
    codes = choose_codebook(values)
    assert (codes[0], codes[-1]) == (-7.0, 40.0)
    np.testing.assert_array_equal(find_codes(values, codes), np.abs(values[:, None] - codes).argmin(axis=1))


def test_nothing_that_is_no_number_is_written(tmp_path):
    gaussians = open_written(tmp_path)
    gaussians.sh_dc[5, 1] = np.nan
    with pytest.raises(DataError, match="sh_dc of splat 5 is nan"):
        save_scene(tmp_path / "b.sog", scene_from_gaussians(gaussians))
    assert not (tmp_path / "b.sog").exists()


def open_written(folder):
    scene = scene_from_gaussians(random_gaussians(np.random.default_rng(3), 40, 1))
    save_scene(folder / "a.sog", scene)
    return open_scene(folder / "a.sog").gaussians
