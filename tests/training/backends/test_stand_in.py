"""The stand-in for gsplat beside gsplat's own plain-torch code, which needs no GPU: projection, tiles, offsets.

Blending is not held against it: gsplat's needs a GPU even there. The CPU's rasterizer stands in (test_gsplat_backend).
"""

from __future__ import annotations

import importlib
import inspect
import warnings
from types import ModuleType
from typing import NamedTuple

import pytest
import torch
from torch import Tensor
from torch_splatting import TorchSplatting, TorchSplatting16

WIDTH, HEIGHT, TILE = 75, 52, 16
COLUMNS, ROWS = -(-WIDTH // TILE), -(-HEIGHT // TILE)


@pytest.fixture(scope="module")
def theirs() -> ModuleType:
    """gsplat's plain-torch code, or a skip: `pip install --no-deps gsplat` is enough for it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("gsplat.cuda._torch_impl", reason="gsplat is not installed", exc_type=ImportError)


class Splats(NamedTuple):
    """What gsplat takes of Gaussians, and of a camera."""

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    view: Tensor
    intrinsics: Tensor


def strewn_splats(opaque: bool) -> Splats:
    """Splats before, beside and behind a camera that is turned and looks past its middle; small ones and large ones."""
    torch.manual_seed(4)
    count, turn = 400, torch.tensor(0.3)
    view = torch.eye(4)
    view[0, 0], view[0, 2], view[2, 0], view[2, 2] = turn.cos(), turn.sin(), -turn.sin(), turn.cos()
    view[:3, 3] = torch.tensor([0.4, -0.2, 1.0])
    return Splats(
        torch.randn(count, 3) * torch.tensor([4.0, 3.0, 5.0]) + torch.tensor([0.0, 0.0, 5.0]),
        torch.randn(count, 4),
        (torch.randn(count, 3) - 2).exp(),
        torch.ones(count) if opaque else torch.rand(count),
        view[None],
        torch.tensor([[[70.0, 0, 31], [0, 64, 29], [0, 0, 1]]]),
    )


def project(splats: Splats) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Radii, means, depths and conics on the stand-in."""
    means, quats, scales, opacities, view, intrinsics = splats
    place = (view, intrinsics, WIDTH, HEIGHT)
    return TorchSplatting().fully_fused_projection(
        means, None, quats, scales, *place, near_plane=0.1, opacities=opacities
    )[:4]


def project_with(theirs: ModuleType, splats: Splats) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Radii, means, depths and conics by gsplat's plain torch.

    It does not know opacities: its boxes are those of opaque splats.
    """
    covariances, _ = theirs._quat_scale_to_covar_preci(splats.quats, splats.scales, compute_preci=False)
    place = (splats.view, splats.intrinsics, WIDTH, HEIGHT)
    return theirs._fully_fused_projection(splats.means, covariances, *place, near_plane=0.1)[:4]


@pytest.mark.parametrize("opaque", [True, False])
def test_splats_are_projected_as_gsplat_does(theirs: ModuleType, opaque: bool) -> None:
    splats = strewn_splats(opaque)
    radii, means, depths, conics = project(splats)
    their_radii, their_means, their_depths, their_conics = project_with(theirs, splats)
    kept, allowed = (radii[0] > 0).all(dim=1), (their_radii[0] > 0).all(dim=1)
    assert 100 < kept.sum() < 300, "some are in view, some are not"
    assert not (kept & ~allowed).any()
    assert (their_radii - radii)[:, kept].min() >= 0, "boxes of fainter splats are no larger"
    if opaque:
        assert torch.equal(kept, allowed)
        assert (their_radii - radii)[:, kept].max() <= 1, "3.33 standard deviations, or where alpha reaches 1/255"
    torch.testing.assert_close(means[:, kept], their_means[:, kept], rtol=1e-5, atol=1e-3)
    torch.testing.assert_close(depths[:, kept], their_depths[:, kept])
    torch.testing.assert_close(conics[:, kept], their_conics[:, kept], rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("library", [TorchSplatting(), TorchSplatting16()], ids=["like 1.5", "like 1.6"])
def test_tiles_are_listed_as_gsplat_does(theirs: ModuleType, library: TorchSplatting) -> None:
    """Keys, splats, their counts and where each tile's list begins: the same numbers."""
    radii, means, depths, _ = project(strewn_splats(opaque=False))
    boxes = (means.nan_to_num(), radii, depths.nan_to_num(), TILE, COLUMNS, ROWS)
    counts, keys, listed = library.isect_tiles(*boxes)
    their_counts, their_keys, their_listed = theirs._isect_tiles(*boxes)
    assert len(keys) > 500
    assert torch.equal(counts, their_counts)
    assert torch.equal(keys, their_keys)
    assert sorted(zip(keys.tolist(), listed.tolist(), strict=True)) == sorted(
        zip(their_keys.tolist(), their_listed.tolist(), strict=True)
    )
    offsets = library.isect_offset_encode(keys, 1, COLUMNS, ROWS)
    assert torch.equal(offsets, theirs._isect_offset_encode(keys, 1, COLUMNS, ROWS))


def test_lists_of_few_tiles_begin_where_gsplat_says(theirs: ModuleType) -> None:
    """Tiles without splats, before, between and behind those that have some; and none at all."""
    library = TorchSplatting()
    for tiles in ([3, 3, 7, 11], []):
        keys = torch.tensor([tile << 32 | 5 for tile in tiles], dtype=torch.int64)
        expected = theirs._isect_offset_encode(keys, 1, COLUMNS, ROWS)
        assert torch.equal(library.isect_offset_encode(keys, 1, COLUMNS, ROWS), expected)


def test_calls_are_those_of_the_installed_gsplat(theirs: ModuleType) -> None:
    """Names, order and defaults of what each of the four functions takes."""
    gsplat = importlib.import_module(theirs.__name__.partition(".")[0])
    library = TorchSplatting16() if gsplat.__version__ >= "1.6" else TorchSplatting()
    for name in ("fully_fused_projection", "isect_tiles", "isect_offset_encode", "rasterize_to_pixels"):
        ours, wanted = (inspect.signature(getattr(module, name)).parameters for module in (library, gsplat))
        assert [(p.name, p.default) for p in ours.values()] == [(p.name, p.default) for p in wanted.values()], name
