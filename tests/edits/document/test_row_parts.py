import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_scene import random_scene

from instdrive_core.edits.bases.editable import find_editable_parts, find_editable_rows
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.mean_colors import compute_mean_colors
from instdrive_core.edits.queries.part_bounds import compute_part_bounds
from instdrive_core.errors import EditError
from instdrive_core.instances.table import compute_middle_bounds
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.selection import Flag


@pytest.fixture
def document():
    return Document(random_scene(count=300))


def test_parts_are_the_rows_of_one_instance_after_another(document):
    ids = tuple(sorted(document.scene.table.instances, reverse=True))
    document.state.change(document.find_rows(ids[:1])[::2], Flag.LOCKED, True)
    for part, instance in zip(find_editable_parts(document, ids), ids, strict=True):
        np.testing.assert_array_equal(part, find_editable_rows(document, (instance,)))


def test_the_instance_of_which_nothing_can_be_edited_is_named(document):
    one, other = sorted(document.scene.table.instances)[:2]
    document.state.change(document.find_rows((other,)), Flag.LOCKED, True)
    with pytest.raises(EditError, match=f"instance {other}: every splat is locked"):
        find_editable_parts(document, (one, other))


def test_rows_can_be_left_out_of_parts():
    parts = RowParts(np.array([4, 5, 1, 2, 3]), np.array([0, 2, 2, 5]))
    fewer = parts.filter(np.array([False, False, True, False, True]))
    assert [part.tolist() for part in fewer] == [[], [], [1, 3]]
    assert [part.tolist() for part in fewer.drop_empty()] == [[1, 3]]


@given(st.lists(st.integers(1, 40), min_size=1, max_size=4), st.integers(0, 99), st.booleans())
def test_bounds_are_those_of_the_table(sizes, seed, moved):
    document, rng = Document(random_scene(count=200)), np.random.default_rng(seed)
    if moved:
        document.apply(MoveInstances((1, 2), (3.0, 1.0, 0.0), (0.8, 0.1, 0.0, 0.2), 1.3))
    rows = rng.permutation(200)[: sum(sizes)]
    parts = RowParts(rows, np.append(0, np.cumsum(sizes)))
    expected = [compute_middle_bounds(document.compute_means(part)) for part in parts]
    np.testing.assert_array_equal(compute_part_bounds(document, parts), np.array(expected, np.float32))


@pytest.mark.parametrize("count", [300, 5000])
def test_mean_colors_weigh_by_opacity(count):
    document, rng = Document(random_scene(count=count)), np.random.default_rng(1)
    gaussians, maps = document.scene.gaussians, rng.normal(size=(2, 3, 4))
    entries = rng.integers(0, 2, count).astype(np.uint16)
    parts = RowParts(rng.permutation(count)[:120], np.array([0, 50, 120]))
    for part, mean in zip(parts, compute_mean_colors(gaussians, parts, maps, entries), strict=True):
        chosen = maps[entries[part]]
        colors = np.einsum("nij,nj->ni", chosen[:, :, :3], color_from_dc(gaussians.sh_dc[part])) + chosen[:, :, 3]
        expected = np.average(np.maximum(colors, 0), axis=0, weights=gaussians.opacities[part])
        np.testing.assert_allclose(mean, expected, rtol=1e-5)


@pytest.mark.parametrize("count", [1000, 3000])
def test_bounds_of_many_splats_and_of_some_that_are_nowhere(count):
    document = Document(random_scene(count=count))
    means = document.scene.gaussians.means
    means[5, 0], means[6, 1] = np.inf, -np.inf
    parts = RowParts(np.arange(count), np.array([0, count]))
    np.testing.assert_array_equal(
        compute_part_bounds(document, parts)[0], np.array(compute_middle_bounds(means), np.float32)
    )
    means[7, 2] = np.nan
    assert np.isnan(compute_part_bounds(document, parts)[0, :, 2]).all()
