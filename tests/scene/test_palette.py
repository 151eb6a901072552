import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scene import random_gaussians

from instdrive_core.maths.spherical_harmonics import color_from_dc, evaluate_rest_basis
from instdrive_core.scene.palette import MAX_ENTRIES, ColorPalette, PaletteFullError, bake_colors

RED = np.array([[0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 0]], np.float32)


def test_entry_zero_is_the_identity():
    palette = ColorPalette(4)
    np.testing.assert_array_equal(palette.matrices, np.eye(3, 4)[None])
    assert palette.alphas.tolist() == [1]
    assert palette.add(np.eye(3, 4, dtype=np.float32)) == 0
    palette.truncate(0)
    assert len(palette) == 1


def test_equal_entries_are_shared_and_truncation_forgets():
    palette = ColorPalette(4)
    assert [palette.add(RED), palette.add(RED, 0.5), palette.add(RED)] == [1, 2, 1]
    palette.truncate(2)
    assert len(palette) == 2
    assert palette.add(RED, 0.25) == 2
    assert palette.alphas.tolist() == [1, 1, 0.25]


def test_assigning_returns_what_was_there_and_marks_it_dirty():
    palette = ColorPalette(6)
    reader = palette.create_dirty_reader()
    assert reader.take() == (0, 6)
    version, entry = palette.version, palette.add(RED)
    before = palette.assign(np.array([1, 4]), np.array([entry, entry], np.uint16))
    assert before.tolist() == [0, 0]
    assert palette.indices.tolist() == [0, 1, 0, 0, 1, 0]
    assert reader.take() == (1, 5)
    assert palette.version > version
    palette.append(2)
    assert reader.take() == (6, 8)
    assert len(palette.indices) == 8


def test_views_cannot_be_written():
    palette = ColorPalette(2)
    for view in (palette.indices, palette.matrices, palette.alphas):
        with pytest.raises(ValueError, match="read-only"):
            view[...] = 0


def test_a_full_palette_says_so():
    palette = ColorPalette(1)
    matrices = np.tile(RED, (MAX_ENTRIES, 1, 1))
    matrices[:, 1, 3] = np.arange(MAX_ENTRIES)
    for matrix in matrices[1:]:
        palette.add(matrix)
    assert len(palette) == MAX_ENTRIES
    with pytest.raises(PaletteFullError, match="65536"):
        palette.add(matrices[0])


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3))
def test_baked_parameters_show_the_mapped_color_from_everywhere(seed, degree):
    rng = np.random.default_rng(seed)
    gaussians, palette = random_gaussians(rng, 12, degree), ColorPalette(12)
    entries = [palette.add(rng.normal(size=(3, 4)).astype(np.float32), alpha) for alpha in (1.0, 0.5)]
    rows = np.array([0, 3, 4, 9])
    palette.assign(rows, np.array(entries * 2, np.uint16))
    dc, rest, logits = bake_colors(gaussians, palette, rows)
    directions = rng.normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = evaluate_rest_basis(directions, gaussians.sh_rest.shape[1])

    def shown(sh_dc, sh_rest):
        return color_from_dc(sh_dc) + np.einsum("nk,nkc->nc", basis, sh_rest)

    matrices = palette.matrices[palette.indices[rows]]
    mapped = np.einsum("nij,nj->ni", matrices[:, :, :3], shown(gaussians.sh_dc[rows], gaussians.sh_rest[rows]))
    np.testing.assert_allclose(shown(dc, rest), mapped + matrices[:, :, 3], atol=1e-4)
    assert logits[0] == gaussians.opacity_logits[0], "an opacity factor of 1 keeps the bits"
    expected = gaussians.opacities[rows] * palette.alphas[palette.indices[rows]]
    np.testing.assert_allclose(1 / (1 + np.exp(-logits)), expected, rtol=1e-3)


def test_forks_go_their_own_ways():
    palette = ColorPalette(4)
    palette.assign(np.array([1]), np.array([palette.add(RED)], np.uint16))
    fork = palette.fork()
    fork.assign(np.array([2]), np.array([fork.add(RED, 0.5)], np.uint16))
    palette.assign(np.array([3]), np.array([palette.add(RED, 0.25)], np.uint16))
    assert (palette.indices.tolist(), fork.indices.tolist()) == ([0, 1, 0, 2], [0, 1, 2, 0])
    assert (palette.alphas.tolist(), fork.alphas.tolist()) == ([1, 1, 0.25], [1, 1, 0.5])
