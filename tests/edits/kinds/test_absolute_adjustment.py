"""Absolute adjustments: the last amount counts, they are remembered by what they colour, and can be taken back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.bases.adjustments import RANGES, compute_adjustment, compute_hue
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.absolute_adjustment import ORDER, SetAdjustment, summarize_adjustments
from instdrive_core.edits.kinds.color import RecolorInstances, ResetColors
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.serialize import edits_from_lines, edits_to_lines
from instdrive_core.errors import EditError
from instdrive_core.maths.spherical_harmonics import color_from_dc

steps_of_sliders = st.sampled_from(sorted(RANGES)).flatmap(
    lambda kind: st.tuples(st.just(kind), st.floats(RANGES[kind].low, RANGES[kind].high, width=16))
)


def amounts(document, *ids):
    return {
        kind: values[0] for kind, values in summarize_adjustments(document, ids).amounts.items() if len(values) == 1
    }


@settings(deadline=None, max_examples=40)
@given(st.lists(steps_of_sliders, max_size=8))
def test_only_the_last_amount_of_each_kind_counts(steps):
    one, other = Document(random_scene(count=60)), Document(random_scene(count=60))
    for kind, amount in steps:
        one.apply(SetAdjustment((2,), kind, amount))
    last = dict(steps)
    for kind, amount in sorted(last.items()):
        other.apply(SetAdjustment((2,), kind, amount))
    assert_same_scene(bake_document(one), bake_document(other))
    for kind, (_, _, neutral) in RANGES.items():
        assert amounts(one, 2)[kind] == pytest.approx(last.get(kind, neutral), abs=1e-5)
    for kind in RANGES:
        one.apply(SetAdjustment((2,), kind, RANGES[kind].neutral))
    assert not one.colors.indices.any(), "all sliders at neutral is no change at all"


def test_the_map_is_the_base_then_the_adjustments_in_order():
    document = Document(random_scene(count=60))
    rows = document.find_rows((2,))
    document.apply(RecolorInstances((2,), "tint", (0.7, 0.4, 0.2)))
    base = document.colors.matrices[document.colors.indices[rows[0]]].astype(float)
    gaussians = document.scene.gaussians
    colors = color_from_dc(gaussians.sh_dc[rows]).astype(float) @ base[:, :3].T + base[:, 3]
    mean = np.average(np.maximum(colors, 0), axis=0, weights=gaussians.opacities[rows])
    chosen = {"temperature": 0.5, "hue": 40.0, "saturation": 1.5, "brightness": 0.8, "contrast": 1.7}
    for kind, amount in chosen.items():
        document.apply(SetAdjustment((2,), kind, amount))
    expected = base
    for kind in ORDER:
        step = compute_adjustment(kind, chosen[kind], mean)
        expected, mean = step[:, :3] @ expected, step[:, :3] @ mean + step[:, 3]
        expected[:, 3] += step[:, 3]
    found = document.colors.matrices[document.colors.indices[rows[0]]]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_undo_finds_the_slider_where_it_was_and_a_zero_can_be_left():
    document = Document(random_scene(count=60))
    before = bake_document(document)
    document.apply(SetAdjustment((2,), "saturation", 0.0))
    document.apply(SetAdjustment((2,), "brightness", 0.0))
    document.apply(SetAdjustment((2,), "brightness", 1.0))
    document.apply(SetAdjustment((2,), "saturation", 1.0))
    assert_same_scene(bake_document(document), before)
    document.undo()
    document.undo()
    assert (amounts(document, 2)["saturation"], amounts(document, 2)["brightness"]) == (0.0, 0.0)
    while document.undo():
        pass
    assert amounts(document, 2) == {kind: neutral for kind, (_, _, neutral) in RANGES.items()}


def test_copies_and_pieces_keep_their_amounts_and_differing_ones_are_told():
    document = Document(random_scene(count=60))
    document.apply(SetAdjustment((2,), "hue", 90.0))
    document.apply(DuplicateInstances((2,), (1.0, 0.0, 0.0)))
    copy = document.first_free_id - 1
    document.apply(SelectRows(document.find_rows((2,))[:1]))
    document.apply(ReassignSelected())
    piece = document.first_free_id - 1
    assert piece != copy
    for instance in (2, copy, piece):
        assert amounts(document, instance)["hue"] == 90.0
    assert summarize_adjustments(document, (1, 2)).amounts["hue"] == (0.0, 90.0)
    document.apply(SetAdjustment((1, 2), "hue", 30.0))
    assert summarize_adjustments(document, (1, 2)).amounts["hue"] == (30.0,)


def test_a_recolour_and_a_relative_adjustment_become_the_base():
    document = Document(random_scene(count=60))
    document.apply(SetAdjustment((2,), "opacity", 0.5))
    document.apply(SetAdjustment((2,), "hue", 90.0))
    document.apply(AdjustInstances((2,), "brightness", 0.5))
    shown = bake_document(document)
    assert amounts(document, 2)["hue"] == 0.0
    document.apply(SetAdjustment((2,), "hue", 20.0))
    document.apply(SetAdjustment((2,), "hue", 0.0))
    assert_same_scene(bake_document(document), shown)
    document.apply(RecolorInstances((2,), "solid", (0.2, 0.4, 0.6)))
    look = summarize_adjustments(document, (2,))
    assert look.recolored
    assert look.amounts["opacity"] == (0.5,), "the opacity stays"


def test_reset_brings_the_trained_bits_back_and_is_replayable():
    document, original = Document(random_scene(count=60)), bake_document(Document(random_scene(count=60)))
    document.apply(RecolorInstances((1, 2), "tint", (0.7, 0.4, 0.2)))
    document.apply(SetAdjustment((2,), "opacity", 0.25))
    document.apply(ResetColors((1, 2)))
    assert_same_scene(bake_document(document), original)
    assert not summarize_adjustments(document, (1, 2)).recolored
    replayed = Document(random_scene(count=60))
    for edit in edits_from_lines(edits_to_lines(document.history.edits)):
        replayed.apply(edit)
    assert_same_scene(bake_document(replayed), original)
    steps = document.history.cursor
    document.apply(ResetColors((1, 2)))
    assert document.history.cursor == steps, "nothing to reset is no step"
    document.undo()
    assert amounts(document, 2)["opacity"] == 0.25


def test_hue_mode_turns_the_mean_to_the_colour_and_keeps_greys():
    document = Document(random_scene(count=60))
    rows = document.find_rows((2,))
    document.scene.gaussians.sh_dc[rows] = np.array([1.2, -0.4, -0.8], np.float32)
    document.scene.gaussians.sh_dc[rows[0]] = -0.5
    document.apply(RecolorInstances((2,), "hue", (0.1, 0.2, 0.9)))
    colors = color_from_dc(bake_document(document).gaussians.sh_dc[rows])
    assert compute_hue(colors[1]) == pytest.approx(compute_hue((0.1, 0.2, 0.9)), abs=0.5)
    np.testing.assert_allclose(colors[0], color_from_dc(np.full(3, -0.5)), atol=1e-6)


@pytest.mark.parametrize(("what", "amount"), [("hue", 181.0), ("opacity", -0.1), ("brightness", float("nan"))])
def test_amounts_are_checked(what, amount):
    with pytest.raises(EditError, match=f"{what}|finite"):
        SetAdjustment((1,), what, amount)


def test_locked_instances_are_spared():
    document = Document(random_scene(count=60))
    document.apply(LockInstances((2,)))
    for edit in (SetAdjustment((2,), "hue", 10.0), ResetColors((2,))):
        with pytest.raises(EditError, match="unlock"):
            document.apply(edit)
