"""Each baseline on a toy drive: better than random IDs, the same bits each time, nothing of the geometry touched."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.baselines.codeword_instances import assign_instances_by_codeword
from instdrive_core.baselines.gaussian_grouping import SHORT as GROUPING
from instdrive_core.baselines.gaussian_grouping import learn_gaussian_grouping
from instdrive_core.baselines.opengaussian import SHORT as OPEN
from instdrive_core.baselines.opengaussian import learn_opengaussian
from instdrive_core.baselines.registry import find_learner
from instdrive_core.cli.train import train
from instdrive_core.training.views.view_store import ViewStore

LEARNERS = {
    "gaussian-grouping": (learn_gaussian_grouping, replace(GROUPING, iterations=120)),
    "opengaussian": (
        learn_opengaussian,
        replace(OPEN, feature_iterations=200, codebook_iterations=40, coarse_clusters=4, fine_clusters=2),
    ),
}


def learned(toy, method, **changes):
    learner, settings = LEARNERS[method]
    notes = []
    result = learner(toy.model, toy.store, toy.config, notes.append, replace(settings, **changes))
    assert notes
    return result


@pytest.mark.parametrize("method", LEARNERS)
def test_it_beats_random_ids_by_far_and_repeats_to_the_bit(toy, method):
    before = {name: value.clone() for name, value in toy.model.parameters.items()}
    first = learned(toy, method)
    count = len(toy.model)
    random_ids = np.random.default_rng(0).integers(1, 5, count)
    assert toy.scene_miou(first.codewords + 1) >= toy.scene_miou(random_ids) + 0.3
    second = learned(toy, method)
    np.testing.assert_array_equal(first.codewords, second.codewords)
    np.testing.assert_array_equal(first.features, second.features)
    assert first.code_bits == 0
    assert len(first.features) == count
    for name, value in toy.model.parameters.items():
        assert value.equal(before[name]), name


@pytest.mark.parametrize("method", LEARNERS)
def test_another_seed_gives_other_features(toy, method):
    short = {"iterations": 3} if method == "gaussian-grouping" else {"feature_iterations": 3, "codebook_iterations": 2}
    one = learned(toy, method, **short)
    other = replace(toy, config=replace(toy.config, seed=4))
    assert not np.array_equal(one.features, learned(other, method, **short).features)


def test_without_a_3d_term_hidden_gaussians_keep_their_first_encoding(toy):
    plain = learned(toy, "gaussian-grouping", iterations=20, neighbor_weight=0.0).features
    first = learned(toy, "gaussian-grouping", iterations=0).features
    with_term = learned(toy, "gaussian-grouping", iterations=20, neighbor_samples=len(toy.model)).features
    still = (plain == first).all(axis=1)
    assert 0 < still.sum() < len(first)
    assert not (with_term[still] == first[still]).all()


@pytest.mark.parametrize("method", LEARNERS)
def test_where_no_view_shows_a_mask_there_is_one_code_and_a_note(toy, method):
    views = [replace(toy.store.get(number), labels=None) for number in range(len(toy.store))]
    result = learned(replace(toy, store=ViewStore.from_views(views)), method)
    assert (result.codewords == 0).all()


def test_the_command_passes_the_method_s_learner_on(monkeypatch, tmp_path):
    requests = []
    monkeypatch.setattr("instdrive_core.cli.train_progress.train_with_progress", requests.append)
    for method in ("instdrive", *LEARNERS):
        train(tmp_path, tmp_path / "run", method=method)
    assert [request.config.method for request in requests] == ["instdrive", *LEARNERS]
    assert requests[0].learner is None
    assert requests[1].learner.func is learn_gaussian_grouping
    assert requests[2].learner.func is learn_opengaussian


def test_methods_of_the_trainer_have_no_learner():
    assert find_learner("instdrive") is None
    assert find_learner("paper") is None
    for method in LEARNERS:
        assert find_learner(method, "paper").keywords["settings"] != find_learner(method).keywords["settings"]


def test_as_published_has_one_instance_per_code_and_none_split(toy):
    scene = toy.drive.scene
    codes = np.where(scene.instance_ids == 4, 1, scene.instance_ids).astype(np.uint32) * 10  # the pole is road
    found = assign_instances_by_codeword(replace(scene, codewords=codes))
    assert len(found.table) == 3
    pairs = np.unique(np.stack([found.instance_ids, codes]), axis=1)
    assert pairs[0].tolist() == [1, 2, 3]
    assert pairs[1].tolist() == [10, 20, 30]
    assert found.gaussians is scene.gaussians
