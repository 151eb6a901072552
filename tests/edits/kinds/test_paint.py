"""Painting changes the body of a car; tyres, glass and lights keep their colours."""

import numpy as np
import pytest
from procedural_street import CAR_COLORS, FIRST_CAR, car, procedural_street

from instdrive_core.edits.bases.body_color import find_body_color
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.paint import PaintInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import EditError
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.scene import scene_from_gaussians

GREEN = (0.1, 0.7, 0.2)


def painted_colors(document, rows):
    return color_from_dc(bake_document(document).gaussians.sh_dc[rows])


@pytest.mark.parametrize("number", [0, 1, 2, 4])
def test_the_body_colour_is_the_paint_of_the_car(number):
    gaussians = car(np.random.default_rng(3), 0.1, CAR_COLORS[number])
    found = np.array(find_body_color(gaussians, np.arange(len(gaussians))))
    expected = np.array(CAR_COLORS[number])
    np.testing.assert_allclose(found / found.sum(), expected / expected.sum(), atol=0.05)


def test_tyres_glass_and_lamps_keep_their_colours():
    document = Document(procedural_street())
    rows = document.find_rows((FIRST_CAR,))
    before = color_from_dc(document.scene.gaussians.sh_dc[rows])
    document.apply(PaintInstances((FIRST_CAR,), GREEN))
    after = painted_colors(document, rows)
    is_dark = before.max(axis=1) < 0.2
    is_body = (before[:, 0] > 0.4) & (before[:, 1] < 0.2)
    assert is_dark.sum() > 50
    np.testing.assert_array_equal(after[is_dark], before[is_dark])
    green = after[is_body]
    assert (green[:, 1] > 2 * green[:, 0]).mean() > 0.9
    lumas = [colors[is_body] @ [0.2126, 0.7152, 0.0722] for colors in (before, after)]
    assert np.corrcoef(*lumas)[0, 1] > 0.95, "light and shade stay"


def test_tolerance_and_reference_say_what_is_painted():
    document = Document(procedural_street())
    rows = document.find_rows((FIRST_CAR,))
    counts = []
    for tolerance in (0.0, 0.1, 0.3, 1.0):
        document.apply(PaintInstances((FIRST_CAR,), GREEN, tolerance))
        counts.append(int((document.colors.matrices[document.colors.indices[rows]] != np.eye(3, 4)).any((1, 2)).sum()))
        document.undo()
    assert counts == sorted(counts)
    assert counts[-1] == len(rows)
    document.apply(PaintInstances((FIRST_CAR,), GREEN, 0.1, (0.03, 0.03, 0.03)))
    before = color_from_dc(document.scene.gaussians.sh_dc[rows])
    changed = np.abs(painted_colors(document, rows) - before).max(axis=1) > 1e-6
    assert 0 < changed.sum() < len(rows) / 2
    assert before[changed].max(axis=1).mean() < 0.2, "the tyres instead of the body"


def test_painting_replaces_a_tint_of_the_whole_car():
    document = Document(procedural_street())
    rows = document.find_rows((FIRST_CAR,))
    document.apply(PaintInstances((FIRST_CAR,), GREEN))
    alone = painted_colors(document, rows)
    document.undo()
    document.apply(RecolorInstances((FIRST_CAR,), "tint", (0.9, 0.2, 0.9)))
    document.apply(PaintInstances((FIRST_CAR,), GREEN))
    np.testing.assert_array_equal(painted_colors(document, rows), alone)


def test_a_single_splat_has_a_body_colour():
    gaussians = car(np.random.default_rng(3), 0.3, (0.2, 0.5, 0.4)).select(np.arange(1))
    assert len(find_body_color(scene_from_gaussians(gaussians).gaussians, np.arange(1))) == 3


@pytest.mark.parametrize(
    "bad",
    [{"tolerance": 1.5}, {"tolerance": float("nan")}, {"color": (0.0, 0.0, 2.0)}, {"reference": (0.1, 0.2, -1.0)}],
)
def test_bad_parameters_are_refused(bad):
    with pytest.raises(EditError):
        PaintInstances(**{"ids": (FIRST_CAR,), "color": GREEN} | bad)


def test_splats_that_are_no_numbers_do_not_count():
    gaussians = car(np.random.default_rng(3), 0.1, CAR_COLORS[0])
    expected = find_body_color(gaussians, np.arange(5, len(gaussians)))
    gaussians.sh_dc[:3] = [[np.nan, 0, 0], [np.inf, np.nan, 0], [0, 0, np.nan]]
    gaussians.log_scales[3, 1], gaussians.opacity_logits[4] = np.inf, np.nan
    np.testing.assert_allclose(find_body_color(gaussians, np.arange(len(gaussians))), expected, atol=0.02)
    assert find_body_color(gaussians, np.arange(3)) == (0.5, 0.5, 0.5)


def test_painting_many_at_once_is_painting_each():
    one, each = Document(procedural_street()), Document(procedural_street())
    ids = tuple(instance.id for instance in one.scene.table)
    one.apply(PaintInstances(ids, GREEN))
    for number in ids:
        each.apply(PaintInstances((number,), GREEN))
    colors = [document.colors.matrices[document.colors.indices] for document in (one, each)]
    np.testing.assert_array_equal(*colors)
