"""Adam on some rows: torch's own where all rows take part, and nothing else touched where they do not."""

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load, save

from instdrive_core.training.gaussians.visible_adam import VisibleAdam

TAILS = {"means": (3,), "opacity_logits": (), "sh_rest": (3, 3), "features": (0,), "sh_none": (0, 3)}
RATES = {"means": 1e-3, "opacity_logits": 0.05, "sh_rest": 2e-3, "features": 0.1, "sh_none": 0.1}


def tensors(count, seed):
    rng = np.random.default_rng(seed)
    return {name: torch.from_numpy(rng.normal(size=(count, *t)).astype(np.float32)) for name, t in TAILS.items()}


def copied(values):
    return {name: value.clone() for name, value in values.items()}


def everything(optimizer):
    return {**optimizer.state_tensors(), **{f"value.{k}": v for k, v in optimizer.parameters.items()}}


def bits(optimizer):
    return {name: value.detach().numpy().tobytes() for name, value in everything(optimizer).items()}


def test_equals_adam_where_every_row_takes_every_step():
    mine, theirs = tensors(50, 0), tensors(50, 0)
    optimizer = VisibleAdam(mine, RATES)
    used = {name: value.requires_grad_(True) for name, value in theirs.items() if value.numel()}
    reference = torch.optim.Adam([{"params": [value], "lr": RATES[name]} for name, value in used.items()], eps=1e-15)
    for step in range(300):
        gradients = tensors(50, step + 1)
        optimizer.step(np.arange(50), gradients, None if step % 2 else torch.ones(50, dtype=torch.bool))
        for name, value in used.items():
            value.grad = gradients[name]
        reference.step()
    for name, value in used.items():
        torch.testing.assert_close(mine[name], value.detach(), rtol=0, atol=2e-3 * RATES[name])
    assert set(optimizer.steps.tolist()) == {300}


@pytest.mark.parametrize("way", ["kernels", "indexing"])
@pytest.mark.parametrize("count", [1, 20_000])
def test_bias_corrections_never_run_out(way, count):
    """A constant gradient moves a row by the learning rate in every step, the first and the 20,000th."""
    values = {"means": torch.zeros(1, 3)}
    optimizer = VisibleAdam(values, {"means": 0.5})
    optimizer.steps[:] = count - 1
    optimizer.first["means"][:] = 1 - 0.9 ** (count - 1)
    optimizer.second["means"][:] = 1 - 0.999 ** (count - 1)
    step = optimizer._step_by_kernels if way == "kernels" else optimizer._step_by_indexing
    step(np.zeros(1, np.int64), {"means": torch.ones(1, 3)}, None)
    np.testing.assert_allclose(values["means"], -0.5, rtol=1e-4)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 60), share=st.sampled_from([0.0, 0.3, 1.0]))
def test_untouched_rows_keep_their_bits_and_both_ways_agree(seed, count, share):
    rng = np.random.default_rng(seed)
    kernels, indexed = (VisibleAdam(tensors(count, seed), RATES) for _ in range(2))
    touched = np.zeros(count, bool)
    before = {name: value.clone() for name, value in everything(kernels).items()}
    for _ in range(3):
        rows = rng.permutation(count)[: rng.integers(0, count + 1)]
        visible = torch.from_numpy(rng.random(len(rows)) < share)
        gradients = {name: value[: len(rows)] for name, value in tensors(count, int(rng.integers(2**31))).items()}
        used = {name: value for name, value in gradients.items() if value.numel()}
        kernels.step(torch.from_numpy(rows), gradients, visible)
        if used:
            indexed._step_by_indexing(rows, used, visible)
        touched[rows[visible.numpy()]] = True
    for name, value in everything(kernels).items():
        torch.testing.assert_close(value, everything(indexed)[name], rtol=1e-5, atol=1e-6, msg=name)
        assert value[~touched].numpy().tobytes() == before[name][~touched].numpy().tobytes(), name
        if value.numel() and touched.any() and name != "steps":
            assert not torch.equal(value[touched], before[name][touched]), name


def test_a_parameter_without_gradient_stays():
    optimizer = VisibleAdam(tensors(9, 0), RATES)
    before, gradients = bits(optimizer), tensors(9, 1)
    optimizer.step(np.arange(9), {"means": None, "opacity_logits": gradients["opacity_logits"]})
    changed = {name for name, value in bits(optimizer).items() if value != before[name]}
    assert changed == {"value.opacity_logits", "first.opacity_logits", "second.opacity_logits", "steps"}


def test_no_gradient_at_all_counts_no_step():
    optimizer = VisibleAdam(tensors(9, 0), RATES)
    before = bits(optimizer)
    optimizer.step(np.arange(9), {"means": None, "features": torch.zeros(9, 0)}, None)
    optimizer.step(np.arange(0), {"means": torch.zeros(0, 3)}, torch.zeros(0, dtype=torch.bool))
    assert bits(optimizer) == before


def test_bits_do_not_depend_on_the_threads():
    def trained():
        optimizer = VisibleAdam(tensors(5000, 0), RATES)
        for step in range(3):
            optimizer.step(np.arange(0, 5000, 2), {k: v[::2] for k, v in tensors(5000, step + 1).items()}, None)
        return bits(optimizer)

    threads, several = numba.get_num_threads(), trained()
    numba.set_num_threads(1)
    try:
        assert trained() == several
    finally:
        numba.set_num_threads(threads)


def test_leaves_that_require_gradients_are_written_in_place():
    values = {"means": torch.zeros(4, 3, requires_grad=True)}
    VisibleAdam(values, {"means": 0.5}).step(np.array([2]), {"means": torch.ones(1, 3)}, None)
    np.testing.assert_allclose(values["means"].detach(), [[0] * 3, [0] * 3, [-0.5] * 3, [0] * 3], rtol=1e-6)
    assert values["means"].is_leaf


def test_restructured_rows_bring_their_moments_unless_fresh():
    old = VisibleAdam(tensors(4, 0), RATES)
    for step in range(3):
        old.step(np.array([1, 3]), {name: value[:2] for name, value in tensors(4, step).items()}, None)
    before = bits(old)
    parents, fresh = np.array([3, 1, 1, 0, 3]), np.array([False, False, True, False, True])
    values = {name: value[parents].contiguous() for name, value in old.parameters.items()}
    new = old.rearrange(parents, fresh, values)
    assert new.steps.tolist() == [3, 3, 0, 0, 0]
    for name in TAILS:
        for theirs, mine in ((new.first, old.first), (new.second, old.second)):
            expected = mine[name][parents].numpy()
            expected[fresh] = 0
            np.testing.assert_array_equal(theirs[name], expected)
    new.step(np.arange(5), tensors(5, 9), None)
    assert bits(old) == before


def test_a_fresh_row_takes_a_step_of_the_full_rate():
    old = VisibleAdam({"means": torch.zeros(1, 3)}, {"means": 0.1})
    for _ in range(500):
        old.step(np.zeros(1, np.int64), {"means": torch.full((1, 3), 1e-3)}, None)
    new = old.rearrange(np.array([0, 0]), np.array([False, True]), {"means": torch.zeros(2, 3)})
    new.step(np.array([1]), {"means": torch.full((1, 3), 7.0)}, None)
    np.testing.assert_allclose(new.parameters["means"], [[0] * 3, [-0.1] * 3], rtol=1e-5)


def test_a_saved_state_goes_on_with_the_same_bits():
    through = VisibleAdam(tensors(30, 0), RATES)
    for step in range(4):
        if step == 2:
            stored = save(through.state_tensors())
            resumed = VisibleAdam(copied(through.parameters), RATES)
            resumed.load_state_tensors(load(stored))
        through.step(np.arange(0, 30, step + 1), {k: v[:: step + 1] for k, v in tensors(30, step).items()}, None)
        if step >= 2:
            resumed.step(np.arange(0, 30, step + 1), {k: v[:: step + 1] for k, v in tensors(30, step).items()}, None)
    assert bits(resumed) == bits(through)


def test_a_state_that_does_not_fit_is_refused():
    optimizer = VisibleAdam(tensors(5, 0), RATES)
    state = VisibleAdam(tensors(6, 0), RATES).state_tensors()
    with pytest.raises(ValueError, match=r"first\.means: expected .*\(5, 3\), found .*\(6, 3\)"):
        optimizer.load_state_tensors(state)
    with pytest.raises(ValueError, match="found nothing"):
        optimizer.load_state_tensors({})


def test_parameters_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="one length"):
        VisibleAdam({"means": torch.zeros(3, 3), "quats": torch.zeros(4, 4)}, {"means": 1, "quats": 1})
    with pytest.raises(ValueError, match="quats has no learning rate"):
        VisibleAdam({"quats": torch.zeros(4, 4)}, {"means": 1})
    with pytest.raises(ValueError, match="contiguous"):
        VisibleAdam({"means": torch.zeros(3, 3).T}, {"means": 1})
