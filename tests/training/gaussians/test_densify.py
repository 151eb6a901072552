"""Growing and pruning: who grows, who goes, what children inherit, and when."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load, save

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.track import Track
from instdrive_core.training.backends.backend import SeenSplats
from instdrive_core.training.gaussians.densify import (
    GrowthStatistics,
    compute_actor_radii,
    counts_gradients,
    densify_and_prune,
    find_last_reset,
    is_densifying_due,
    is_reset_due,
    reset_opacities,
)
from instdrive_core.training.gaussians.visible_adam import VisibleAdam
from instdrive_core.training.settings.config import DensifyConfig, GeometryConfig, build_train_config

CPU = torch.device("cpu")
RADIUS = 20.0
CONFIG = DensifyConfig(max_gaussians=1000)
CLONE, PRUNE = CONFIG.clone_scale * RADIUS, CONFIG.prune_scale * RADIUS


def gaussians(count, seed=0, size=0.05, opacity_logit=0.0):
    """Distinct in every attribute, sizes a little below `size`."""
    rng = np.random.default_rng(seed)
    tails = {"means": (3,), "quats": (4,), "log_scales": (3,), "opacity_logits": ()}
    tails |= {"sh_dc": (3,), "sh_rest": (3, 3), "features": (4,)}
    values = {name: torch.from_numpy(rng.normal(size=(count, *t)).astype(np.float32)) for name, t in tails.items()}
    values["log_scales"] = np.log(size) - values["log_scales"].abs() * 0.1
    values["opacity_logits"] = opacity_logit + 0.01 * values["opacity_logits"]
    return values


def statistics_of(gradients):
    """One view each, which saw these gradients."""
    result = GrowthStatistics.empty(len(gradients), CPU)
    means = torch.as_tensor(gradients, dtype=torch.float32)
    result.add(np.arange(len(means)), SeenSplats(torch.ones(len(means), dtype=torch.bool), means))
    return result


def refine(parameters, nodes, gradients, config=CONFIG, seed=0, prune_large=False, radii=None):
    rng, nodes = np.random.default_rng(seed), np.asarray(nodes, np.uint16)
    return densify_and_prune(parameters, nodes, statistics_of(gradients), config, RADIUS, rng, prune_large, radii)


def frozen(parameters):
    return {name: value.numpy().tobytes() for name, value in parameters.items()}


HIGH, LOW = 1e-2, 1e-5


@st.composite
def situations(draw):
    """Parameters, nodes, gradients: rows of every kind, on background and actors."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    count = draw(st.integers(1, 80))
    parameters = gaussians(count, int(rng.integers(2**31)))
    sizes = rng.choice([0.01, 0.1, 0.5, 1.5, 2.5, 10.0], count)
    parameters["log_scales"] += torch.from_numpy(np.log(sizes / 0.05).astype(np.float32))[:, None]
    parameters["opacity_logits"] += torch.from_numpy(rng.choice([-9.0, -4.0, 3.0], count).astype(np.float32))
    nodes = np.sort(rng.integers(0, draw(st.integers(1, 4)), count)).astype(np.uint16)
    gradients = rng.choice([0, LOW, HIGH, 2 * HIGH], count)
    return parameters, nodes, gradients, int(rng.integers(2**31))


@settings(max_examples=150, deadline=None)
@given(situation=situations(), cap=st.integers(1, 120), prune_large=st.booleans())
def test_the_books_balance(situation, cap, prune_large):
    parameters, nodes, gradients, seed = situation
    count, before, config = len(nodes), frozen(parameters), replace(CONFIG, max_gaussians=cap)
    result = refine(parameters, nodes, gradients, config, seed, prune_large)
    assert frozen(parameters) == before
    assert len(result.nodes) == count + result.cloned + result.split - result.pruned
    assert result.fresh.sum() == result.cloned + 2 * result.split
    assert 0 < len(result.nodes) <= max(cap, count)
    assert np.all(np.diff(result.nodes.astype(int)) >= 0)
    np.testing.assert_array_equal(result.nodes, nodes[result.parents])
    assert len(set(result.parents[~result.fresh])) == np.count_nonzero(~result.fresh)
    for name, value in result.parameters.items():
        assert value.shape == (len(result.nodes), *parameters[name].shape[1:])
        old = parameters[name][result.parents]
        same = torch.from_numpy(~result.fresh) if name in ("means", "log_scales") else slice(None)
        assert torch.equal(value[same], old[same]), name


@settings(max_examples=50, deadline=None)
@given(situation=situations())
def test_who_grows_and_who_goes_where_there_is_room(situation):
    parameters, nodes, gradients, seed = situation
    result = refine(parameters, nodes, gradients, seed=seed, prune_large=True)
    sizes = parameters["log_scales"].exp().max(dim=1).values.numpy()
    faint = torch.sigmoid(parameters["opacity_logits"]).numpy() < CONFIG.prune_opacity
    wants = (gradients > CONFIG.gradient_threshold) & ~faint
    splits = wants & (sizes > CLONE) & (sizes / 1.6 <= PRUNE)
    clones = wants & (sizes <= CLONE)
    gone = faint | ((sizes > PRUNE) & ~splits)
    children = np.bincount(result.parents, minlength=len(nodes))
    if gone.all():
        assert len(result.nodes) == 1
        return
    np.testing.assert_array_equal(children, np.where(gone, 0, np.where(splits | clones, 2, 1)))
    assert (result.cloned, result.split, result.pruned) == (clones.sum(), splits.sum(), gone.sum())


def test_nothing_changes_where_nothing_qualifies():
    parameters, nodes = gaussians(30), np.repeat([0, 1, 3], 10)
    result = refine(parameters, nodes, np.full(30, LOW), prune_large=True)
    assert frozen(result.parameters) == frozen(parameters)
    np.testing.assert_array_equal(result.parents, np.arange(30))
    assert not result.fresh.any()
    assert (result.cloned, result.split, result.pruned) == (0, 0, 0)


def test_a_clone_equals_its_parent_which_is_not_fresh():
    parameters = gaussians(3)
    result = refine(parameters, [0, 0, 0], [LOW, HIGH, LOW])
    assert result.parents.tolist() == [0, 1, 2, 1]
    assert result.fresh.tolist() == [False, False, False, True]
    for value in result.parameters.values():
        assert torch.equal(value[3], value[1])


def test_halves_of_a_split_are_samples_of_their_parent():
    """Whitened by the parent's covariance the offsets are standard normal; all scales are smaller by 1.6."""
    parameters, count = gaussians(4000, size=0.5), 4000
    parameters["log_scales"] += torch.tensor([0.0, -1.0, -2.0])
    parameters["quats"] *= torch.rand(count, 1, generator=torch.Generator().manual_seed(0)) + 0.5
    result = refine(parameters, np.zeros(count), np.full(count, HIGH), replace(CONFIG, max_gaussians=10_000))
    assert (result.split, len(result.nodes)) == (count, 2 * count)
    old = {name: parameters[name][result.parents].double().numpy() for name in ("means", "quats", "log_scales")}
    offsets = result.parameters["means"].double().numpy() - old["means"]
    rotations = matrix_from_quaternion(old["quats"])
    white = np.einsum("nji,nj->ni", rotations, offsets) / np.exp(old["log_scales"])
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(3), atol=0.06)
    np.testing.assert_allclose(white.mean(axis=0), 0, atol=0.05)
    assert np.abs(white).max() < 6
    shrunk = old["log_scales"] - np.log(1.6)
    np.testing.assert_allclose(result.parameters["log_scales"].numpy(), shrunk, atol=1e-5)
    first, second = offsets[:count], offsets[count:]
    np.testing.assert_array_equal(result.parents[:count], result.parents[count:])
    assert np.abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.05


def test_under_the_cap_the_largest_gradients_grow_and_pruning_makes_room():
    parameters = gaussians(6)
    parameters["opacity_logits"][0] = -9
    gradients = [HIGH, 3 * HIGH, HIGH, 4 * HIGH, 2 * HIGH, LOW]
    result = refine(parameters, np.zeros(6), gradients, replace(CONFIG, max_gaussians=7))
    assert (result.cloned, result.pruned, len(result.nodes)) == (2, 1, 7)
    assert result.parents[result.fresh].tolist() == [1, 3]
    full = refine(parameters, np.zeros(6), gradients, replace(CONFIG, max_gaussians=3))
    assert (full.cloned, full.pruned, len(full.nodes)) == (0, 1, 5)


def test_of_equal_gradients_the_first_rows_grow():
    result = refine(gaussians(6), np.zeros(6), np.full(6, HIGH), replace(CONFIG, max_gaussians=8))
    assert result.parents[result.fresh].tolist() == [0, 1]


def test_oversized_gaussians_go_when_allowed_unless_halving_mends_them():
    parameters = gaussians(3, size=1.3 * PRUNE)
    parameters["log_scales"][2] += 1
    gradients = [LOW, HIGH, HIGH]
    kept = refine(parameters, np.zeros(3), gradients, prune_large=False)
    assert (kept.split, kept.pruned) == (2, 0)
    result = refine(parameters, np.zeros(3), gradients, prune_large=True)
    assert (result.split, result.pruned) == (1, 2)
    assert result.parents.tolist() == [1, 1]
    parameters["log_scales"][2] -= 4
    no_room = refine(parameters, np.zeros(3), gradients, replace(CONFIG, max_gaussians=2), prune_large=True)
    assert no_room.parents.tolist() == [2]
    assert (no_room.split, no_room.pruned) == (0, 2)


def test_the_scene_keeps_its_most_opaque_gaussian():
    parameters = gaussians(5, opacity_logit=-9.0)
    result = refine(parameters, [0, 0, 1, 1, 2], np.full(5, HIGH))
    assert result.parents.tolist() == [int(parameters["opacity_logits"].argmax())]
    assert result.pruned == 4


def test_an_actor_may_lose_all_its_rows():
    parameters = gaussians(6)
    parameters["opacity_logits"][2:4] = -9
    result = refine(parameters, [0, 0, 1, 1, 2, 2], [HIGH, LOW, HIGH, HIGH, LOW, HIGH])
    assert result.nodes.tolist() == [0, 0, 0, 2, 2, 2]
    assert result.parents.tolist() == [0, 1, 0, 4, 5, 5]


def test_sizes_on_an_actor_are_judged_by_its_box():
    box = Track("car", "Car", np.array([1.9, 4.5, 1.6]), np.zeros(1), np.eye(4)[None])
    ship = replace(box, dimensions=np.array([80.0, 300, 50]))
    parameters = gaussians(3, size=0.15)
    result = refine(parameters, [0, 1, 2], np.full(3, HIGH), radii=compute_actor_radii([box, ship]))
    assert compute_actor_radii([box])[0] == pytest.approx(5.14, abs=0.01)
    assert result.parents[result.fresh].tolist() == [0, 1, 1, 2]  # cloned, split, cloned
    assert (result.cloned, result.split) == (2, 1)
    parameters = gaussians(3, size=1.0)
    result = refine(parameters, [0, 1, 2], np.full(3, LOW), prune_large=True, radii=compute_actor_radii([box, ship]))
    assert result.nodes.tolist() == [0, 2]


def test_the_random_numbers_decide_and_nothing_else():
    parameters, nodes, gradients = gaussians(40, size=0.5), np.repeat([0, 1], 20), np.full(40, HIGH)
    results = [frozen(refine(parameters, nodes, gradients, seed=seed).parameters) for seed in (1, 1, 2)]
    assert results[0] == results[1] != results[2]


def test_leaves_stay_leaves():
    parameters = gaussians(3)
    parameters["features"].requires_grad_(True)
    result = refine(parameters, np.zeros(3), np.full(3, HIGH))
    assert {name: value.requires_grad for name, value in result.parameters.items()} == {
        name: name == "features" for name in parameters
    }
    assert all(value.is_leaf and value.is_contiguous() for value in result.parameters.values())


def test_statistics_count_the_views_that_saw_a_gaussian():
    statistics = GrowthStatistics.empty(5, CPU)
    seen = SeenSplats(torch.tensor([True, False, True]), torch.tensor([1.0, 99, 3]))
    statistics.add(np.array([0, 1, 4]), seen)
    statistics.add(torch.tensor([4, 0, 2]), seen)
    np.testing.assert_allclose(statistics.mean_gradients(), [1, 0, 3, 0, 2])
    np.testing.assert_allclose(statistics.view_counts, [1, 0, 1, 0, 2])
    again = statistics.rearrange(np.array([0, 0]))
    assert len(again) == 2
    assert not any(value.any() for value in again.state_tensors().values())


def test_statistics_need_a_backward_pass():
    with pytest.raises(ValueError, match="backward"):
        GrowthStatistics.empty(1, CPU).add(np.zeros(1, np.int64), SeenSplats())


def test_saved_statistics_go_on_with_the_same_bits():
    rng = np.random.default_rng(0)
    views = [(rng.permutation(9)[:6], torch.from_numpy(rng.random(6, np.float32))) for _ in range(4)]
    through, resumed = GrowthStatistics.empty(9, CPU), GrowthStatistics.empty(9, CPU)
    for number, (rows, gradients) in enumerate(views):
        if number == 2:
            resumed.load_state_tensors(load(save(through.state_tensors())))
        for statistics in (through, resumed)[: 1 + (number >= 2)]:
            statistics.add(rows, SeenSplats(gradients > 0.3, gradients))
    assert frozen(through.state_tensors()) == frozen(resumed.state_tensors())
    with pytest.raises(ValueError, match=r"gradient_sums: expected shape \(4,\), found \(9,\)"):
        GrowthStatistics.empty(4, CPU).load_state_tensors(through.state_tensors())


def test_a_reset_dims_what_is_opaque_and_forgets_its_momentum():
    parameters = gaussians(3)
    parameters["opacity_logits"][:] = torch.tensor([5.0, -9.0, 0.0])
    parameters["opacity_logits"].requires_grad_(True)
    optimizer = VisibleAdam(parameters, dict.fromkeys(parameters, 0.1))
    optimizer.step(np.arange(3), gaussians(3, 1), None)
    means, low = optimizer.first["means"].clone(), parameters["opacity_logits"][1].item()
    reset_opacities(parameters, optimizer, CONFIG)
    opacities = torch.sigmoid(parameters["opacity_logits"]).detach()
    np.testing.assert_allclose(opacities[[0, 2]], 2 * CONFIG.prune_opacity, rtol=1e-5)
    assert parameters["opacity_logits"][1].item() == low
    assert not optimizer.first["opacity_logits"].any()
    assert not optimizer.second["opacity_logits"].any()
    assert torch.equal(optimizer.first["means"], means)


def steps_of(predicate, config, total):
    return [step for step in range(total) if predicate(config, step, total)]


def test_the_schedule_of_a_long_run():
    config, total = DensifyConfig(), 30_000
    refinements, resets = steps_of(is_densifying_due, config, total), steps_of(is_reset_due, config, total)
    assert resets == [3000, 6000, 9000, 12_000]
    assert refinements[:3] == [500, 600, 700]
    assert refinements[-1] == 14_900
    assert [step for step in refinements if 2800 <= step <= 3700] == [2800, 2900, 3500, 3600, 3700]
    assert not counts_gradients(config, 3100, total)
    assert not counts_gradients(config, 15_000, total)
    assert (find_last_reset(config, 2999, total), find_last_reset(config, 3000, total)) == (0, 3000)
    assert find_last_reset(config, 29_999, total) == 12_000


def test_a_short_run_is_never_reset():
    config, total = DensifyConfig(), GeometryConfig().iterations
    assert not steps_of(is_reset_due, config, total)
    assert steps_of(is_densifying_due, config, total) == list(range(500, 2250, 100))


@pytest.mark.parametrize("preset", ["demo", "quick", "paper"])
def test_presets_end_growing_in_time(preset):
    config = build_train_config("instdrive", preset)
    steps = steps_of(is_densifying_due, config.densify, config.geometry.iterations)
    assert steps
    assert steps[-1] < config.densify.stop * config.geometry.iterations


@settings(max_examples=100, deadline=None)
@given(
    total=st.integers(0, 3000),
    start=st.integers(0, 400),
    stop=st.floats(0, 1),
    every=st.integers(1, 150),
    reset_every=st.integers(2, 700),
)
def test_every_reset_is_followed_by_refinement_and_none_comes_after_the_end(total, start, stop, every, reset_every):
    config = DensifyConfig(start=start, stop=stop, every=every, reset_every=reset_every)
    refinements, resets = steps_of(is_densifying_due, config, total), steps_of(is_reset_due, config, total)
    assert all(start <= step < stop * total and step % every == 0 for step in refinements)
    assert not set(resets) & set(refinements)
    assert all(counts_gradients(config, step, total) for step in refinements)
    if resets and start < resets[-1]:
        assert refinements
        assert refinements[-1] > resets[-1]
    assert not steps_of(is_densifying_due, replace(config, max_gaussians=0), total)
    assert not steps_of(is_reset_due, replace(config, max_gaussians=0), total)
