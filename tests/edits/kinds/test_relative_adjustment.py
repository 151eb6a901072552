"""Adjustments of colour: what each keeps, that they add up, follow the view and survive export."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.bases.adjustments import LUMA, RANGES, compute_adjustment, compute_hue_rotation
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.maths.spherical_harmonics import color_from_dc, evaluate_rest_basis

GRAY = np.full(3, 0.4)
MEAN = np.array([0.5, 0.2, 0.1])
amounts = st.sampled_from(sorted(RANGES)).flatmap(
    lambda kind: st.tuples(st.just(kind), st.floats(RANGES[kind].low, RANGES[kind].high))
)


@given(st.floats(-180, 180), st.floats(-180, 180))
def test_hue_turns_within_planes_of_equal_luma(one, other):
    turn = compute_hue_rotation(one)
    np.testing.assert_allclose(turn @ GRAY, GRAY, atol=1e-12)
    np.testing.assert_allclose(LUMA @ turn, LUMA, atol=1e-12)
    np.testing.assert_allclose(turn @ compute_hue_rotation(other), compute_hue_rotation(one + other), atol=1e-9)


def test_a_third_of_a_turn_makes_red_green():
    red = np.array([1.0, 0, 0])
    assert np.argmax(compute_hue_rotation(120.0) @ red) == 1
    assert np.argmax(compute_hue_rotation(-120.0) @ red) == 2


@given(st.floats(0, 4))
def test_saturation_keeps_luma_and_contrast_keeps_the_mean(factor):
    np.testing.assert_allclose(LUMA @ compute_adjustment("saturation", factor, MEAN)[:, :3], LUMA, atol=1e-12)
    contrast = compute_adjustment("contrast", factor, MEAN)
    np.testing.assert_allclose(contrast[:, :3] @ MEAN + contrast[:, 3], MEAN, atol=1e-12)
    np.testing.assert_allclose(np.diff(contrast[:, :3] @ np.tile([0.1, 0.2], (3, 1))), 0.1 * factor, atol=1e-12)


def test_warm_is_red_and_greys_keep_their_luma():
    warm = compute_adjustment("temperature", 1.0, MEAN)[:, :3] @ GRAY
    assert warm[0] > warm[1] > warm[2]
    assert LUMA @ warm == pytest.approx(0.4)
    cool = compute_adjustment("temperature", -1.0, MEAN)[:, :3] @ GRAY
    assert cool[0] < cool[1] < cool[2]


def shown(gaussians, rows, direction):
    basis = evaluate_rest_basis(np.tile(direction, (len(rows), 1)), gaussians.sh_rest.shape[1])
    return color_from_dc(gaussians.sh_dc[rows]) + np.einsum("nk,nkc->nc", basis, gaussians.sh_rest[rows])


def shown_mean(document, rows):
    """Weighted by opacity, without view dependence."""
    gaussians, palette = document.scene.gaussians, document.colors
    maps = palette.matrices[palette.indices[rows]].astype(float)
    colors = np.einsum("nij,nj->ni", maps[:, :, :3], color_from_dc(gaussians.sh_dc[rows])) + maps[:, :, 3]
    return np.average(np.maximum(colors, 0), axis=0, weights=gaussians.opacities[rows])


@given(st.lists(amounts, min_size=1, max_size=3), st.booleans())
def test_adjustments_add_up_from_every_side_after_export(steps, tinted):
    document = Document(random_scene(count=60))
    rows = document.find_rows((2,))
    if tinted:
        document.apply(RecolorInstances((2,), "tint", (0.6, 0.3, 0.2)))
    before = bake_document(document)
    expected = {side: shown(before.gaussians, rows, side) for side in ((1.0, 0.0, 0.0), (0.6, 0.0, -0.8))}
    opacity = before.gaussians.opacities[rows].astype(float)
    for kind, amount in steps:
        matrix = compute_adjustment(kind, amount, shown_mean(document, rows))
        document.apply(AdjustInstances((2,), kind, amount))
        expected = {side: colors @ matrix[:, :3].T + matrix[:, 3] for side, colors in expected.items()}
        opacity = opacity * (amount if kind == "opacity" else 1)
    after = bake_document(document)
    for side, colors in expected.items():
        np.testing.assert_allclose(shown(after.gaussians, rows, side), colors, atol=1e-3)
    np.testing.assert_allclose(after.gaussians.opacities[rows], opacity, atol=2e-6)
    for _ in range(document.history.cursor):
        document.undo()
    assert_same_scene(bake_document(document), bake_document(Document(random_scene(count=60))))


def test_neutral_amounts_are_no_step_and_recolouring_keeps_the_opacity():
    document = Document(random_scene())
    for kind, (_, _, neutral) in RANGES.items():
        document.apply(AdjustInstances((1, 2), kind, neutral))
    assert document.history.cursor == 0
    document.apply(AdjustInstances((2,), "opacity", 0.5))
    document.apply(AdjustInstances((2,), "hue", 90.0))
    document.apply(RecolorInstances((1, 2), "solid", (1.0, 0.0, 0.0)))
    entries = document.colors.indices[document.find_rows((2,))]
    assert document.colors.alphas[entries[0]] == 0.5
    np.testing.assert_array_equal(document.colors.matrices[entries[0]][:, :3], 0)
    assert document.colors.alphas[document.colors.indices[document.find_rows((1,))[0]]] == 1
