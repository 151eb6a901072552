"""A run with a baseline's learner after an RGB stage leaves its instances on the geometry that any method gets."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from written_street import SMALL, copy_street

from instdrive_core.baselines.codeword_instances import assign_instances_by_codeword
from instdrive_core.baselines.gaussian_grouping import SHORT as GROUPING
from instdrive_core.baselines.gaussian_grouping import learn_gaussian_grouping
from instdrive_core.baselines.opengaussian import SHORT as OPEN
from instdrive_core.baselines.opengaussian import learn_opengaussian
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, build_train_config

FEW = {
    "gaussian-grouping": partial(learn_gaussian_grouping, settings=replace(GROUPING, iterations=10)),
    "opengaussian": partial(learn_opengaussian, settings=replace(OPEN, feature_iterations=10, codebook_iterations=3)),
}


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    return copy_street(SMALL, tmp_path_factory.mktemp("street") / "clip", tmp_path_factory)


def trained(street, out, method):
    config = build_train_config(method, "demo", seed=1)
    config = replace(
        config,
        init=InitConfig(lidar_points=3_000, near_points=200, far_points=200, actor_points=100),
        geometry=replace(config.geometry, iterations=8, coarse_iterations=4, sky_resolution=8),
        instances=replace(config.instances, iterations=2, pixels_per_view=500, feature_dim=8),
    )
    request = RunRequest(street, out, ClipOptions(cameras="1"), config, learner=FEW.get(method))
    return read_scene_folder(run_training(request, lambda event: None, lambda note: None))


def test_a_run_with_either_baseline_leaves_its_instances_on_equal_geometry(street, tmp_path):
    scenes = {method: trained(street, tmp_path / method, method) for method in FEW}
    for method, scene in scenes.items():
        assert scene.code_bits == 0, method
        assert len(scene.table) > 1
        published = assign_instances_by_codeword(scene)
        assert len(published.table) == len(np.unique(scene.codewords)) > 1
    one, other = scenes.values()
    np.testing.assert_array_equal(one.gaussians.means, other.gaussians.means)
    assert one.gaussians.features.shape[1] == 16
    assert other.gaussians.features.shape[1] == 6
