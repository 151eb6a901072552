"""The GPU's rasterizer against the CPU's. Where there is no GPU, a stand-in for gsplat runs the same wrapper."""

from __future__ import annotations

import gc
import inspect
import weakref

import numpy as np
import pytest
import torch
from torch_splatting import GPU, TorchSplatting, TorchSplatting16, backend_of

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.training.backends.backend import SeenSplats
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.backends.gsplat_backend import GsplatBackend

CAMERA = Camera(40.0, 42.0, 23.0, 16.0, 47, 33, look_at(np.array([0.0, -4, 1]), np.array([0.0, 0, 0])))
ASIDE = Camera(40.0, 42.0, 23.0, 16.0, 47, 33, look_at(np.array([0.0, -1.5, 0.3]), np.array([1.5, 0, 0])))
NAMES = ("means", "quats", "log_scales", "logits", "channels")


@pytest.fixture(params=["like 1.5", "like 1.6", GPU])
def backend(request: pytest.FixtureRequest) -> GsplatBackend:
    return backend_of(request.param)


def parameters(backend: GsplatBackend, count: int = 40, channels: int = 6, seed: int = 0) -> dict[str, torch.Tensor]:
    """Opacities stay below 0.99: gsplat 1.5 clips at 0.999, 1.6 at 0.99."""
    rng = np.random.default_rng(seed)
    arrays = {
        "means": rng.uniform(-1.2, 1.2, (count, 3)),
        "quats": rng.normal(size=(count, 4)),
        "log_scales": rng.normal(-1.8, 0.4, (count, 3)),
        "logits": np.minimum(rng.normal(0, 2.5, count), 4),
        "channels": rng.uniform(-1, 1, (count, channels)),
    }
    return {
        name: torch.tensor(array, dtype=torch.float32, device=backend.device).requires_grad_(True)
        for name, array in arrays.items()
    }


def twins(p: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Copies on the CPU."""
    return {name: value.detach().cpu().clone().requires_grad_(True) for name, value in p.items()}


def loss_weights(channels: int, seed: int = 1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = (CAMERA.height, CAMERA.width)
    return [rng.normal(size=size).astype(np.float32) for size in ((*shape, channels), shape, shape)]


def weighted_sum(outputs: tuple[torch.Tensor, ...], weights: list[np.ndarray]) -> torch.Tensor:
    pairs = zip(outputs, weights, strict=True)
    return torch.stack([(output * torch.from_numpy(weight).to(output)).sum() for output, weight in pairs]).sum()


def assert_close(found: torch.Tensor | None, wanted: torch.Tensor | None, share: float = 1e-3) -> None:
    """Equal up to a share of the largest entry."""
    assert found is not None
    assert wanted is not None
    scale = max(float(wanted.detach().abs().max()), 1e-3)
    torch.testing.assert_close(found.detach().cpu(), wanted.detach(), rtol=share, atol=share * scale)


@pytest.mark.parametrize("camera", [CAMERA, ASIDE], ids=["ahead", "aside"])
@pytest.mark.parametrize(("channels", "geometry_channels"), [(6, 3), (3, 3), (40, 3), (5, 0), (7, 6)])
def test_values_and_gradients_are_those_of_the_cpu(
    backend: GsplatBackend, camera: Camera, channels: int, geometry_channels: int
) -> None:
    ours, weights = parameters(backend, channels=channels), loss_weights(channels)
    theirs = twins(ours)
    outputs = backend.rasterize(*(ours[name] for name in NAMES), camera, geometry_channels)
    expected = CpuBackend().rasterize(*(theirs[name] for name in NAMES), camera, geometry_channels)
    for found, wanted in zip(outputs, expected, strict=True):
        assert_close(found, wanted, 1e-4)
    weighted_sum(outputs, weights).backward()
    weighted_sum(expected, weights).backward()
    for name in NAMES:
        assert_close(ours[name].grad, theirs[name].grad)


@pytest.mark.parametrize("camera", [CAMERA, ASIDE], ids=["ahead", "aside"])
def test_densification_learns_the_same(backend: GsplatBackend, camera: Camera) -> None:
    ours, weights = parameters(backend), loss_weights(6)
    theirs, seen, expected = twins(ours), SeenSplats(), SeenSplats()
    outputs = backend.rasterize(*(ours[name] for name in NAMES), camera, 3, seen)
    assert seen.visible is None
    weighted_sum(outputs, weights).backward()
    weighted_sum(CpuBackend().rasterize(*(theirs[name] for name in NAMES), camera, 3, expected), weights).backward()
    assert seen.visible is not None
    assert expected.visible is not None
    assert seen.visible.cpu().tolist() == expected.visible.tolist()
    assert 0 < expected.visible.sum() < len(expected.visible)
    assert_close(seen.gradients, expected.gradients)


def test_features_leave_the_geometry_alone(backend: GsplatBackend) -> None:
    p, seen = parameters(backend), SeenSplats()
    image, _, _ = backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3, seen)
    image[..., 3:].square().sum().backward()
    assert float(p["channels"].grad[:, 3:].abs().sum()) > 0
    for name in ("means", "quats", "log_scales", "logits"):
        assert not p[name].grad.any()
    assert seen.gradients is not None
    assert not seen.gradients.any()


def test_only_what_wants_a_gradient_gets_one(backend: GsplatBackend) -> None:
    p = parameters(backend)
    for name in NAMES[:4]:
        p[name].requires_grad_(False)
    seen = SeenSplats()
    image, _, _ = backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3, seen)
    image.sum().backward()
    assert p["channels"].grad.any()
    assert p["means"].grad is None
    assert seen.visible is not None
    assert seen.visible.any()
    with torch.no_grad():
        image, _, _ = backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    assert not image.requires_grad


def test_upstream_operations_get_their_gradient(backend: GsplatBackend) -> None:
    p, moved = parameters(backend), parameters(backend)
    shift = torch.zeros(3, device=backend.device, requires_grad=True)
    for means, values in ((p["means"], p), (moved["means"] + shift, moved)):
        image, _, _ = backend.rasterize(means, *(values[name] for name in NAMES[1:]), CAMERA, 3)
        image.square().sum().backward()
    assert shift.grad is not None
    torch.testing.assert_close(shift.grad, p["means"].grad.sum(dim=0), rtol=1e-3, atol=1e-4)


def test_changes_between_the_passes_are_noticed(backend: GsplatBackend) -> None:
    p = parameters(backend)
    image, _, _ = backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    with torch.no_grad():
        p["quats"].add_(1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        image.sum().backward()


def test_no_gaussians_make_an_empty_picture_with_a_backward_pass(backend: GsplatBackend) -> None:
    p, seen = (
        {name: value.detach()[:0].requires_grad_(True) for name, value in parameters(backend).items()},
        SeenSplats(),
    )
    image, depth, alpha = backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3, seen)
    assert image.shape == (33, 47, 6)
    assert not any(output.any() for output in (image, depth, alpha))
    (image.sum() + depth.sum() + alpha.sum()).backward()
    assert p["means"].grad.shape == (0, 3)
    assert seen.visible is not None
    assert seen.visible.shape == (0,)


def test_a_view_that_sees_nothing(backend: GsplatBackend) -> None:
    away = Camera(40.0, 42.0, 23.0, 16.0, 47, 33, look_at(np.array([0.0, -4, 1]), np.array([0.0, -9, 1])))
    p, seen = parameters(backend), SeenSplats()
    image, _, alpha = backend.rasterize(*(p[name] for name in NAMES), away, 3, seen)
    assert not image.any()
    assert not alpha.any()
    (image.sum() + alpha.sum()).backward()
    assert not p["means"].grad.any()
    assert seen.visible is not None
    assert not seen.visible.any()


@pytest.mark.parametrize(("channels", "geometry_channels"), [(6, 7), (6, -1), (64, 33)])
def test_impossible_geometry_channels_are_refused(
    backend: GsplatBackend, channels: int, geometry_channels: int
) -> None:
    p = parameters(backend, channels=channels)
    with pytest.raises(ValueError, match=f"geometry_channels is {geometry_channels}"):
        backend.rasterize(*(p[name] for name in NAMES), CAMERA, geometry_channels)


def test_projection_and_tiles_are_shared_between_the_passes() -> None:
    library = TorchSplatting()
    backend = GsplatBackend(torch.device("cpu"), library)
    p = parameters(backend, channels=3 + 40)
    backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    assert library.calls == ["project", "tiles", "blend", "blend", "blend"]
    assert library.drawn_channels == [4, 32, 8]  # RGB with depth; 40 features in two parts


@pytest.mark.parametrize("with_backward", [True, False])
def test_a_views_graph_is_freed_with_its_picture(with_backward: bool) -> None:
    """Without waiting for the garbage collector: a few views of a million Gaussians would fill a GPU."""
    library, projections = TorchSplatting(), []
    backend, project = GsplatBackend(torch.device("cpu"), library), library.fully_fused_projection

    def watched(*args, **options):
        found = project(*args, **options)
        projections.append(weakref.ref(found[1]))
        return found

    library.fully_fused_projection = watched
    p = parameters(backend)
    gc.disable()
    try:
        image, depth, alpha = backend.rasterize(*(p[name] for name in NAMES), CAMERA, 3, SeenSplats())
        assert projections[0]() is not None
        if with_backward:
            image.sum().backward()
        del image, depth, alpha
        assert projections[0]() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(("kind", "largest"), [("like 1.5", 0.999), ("like 1.6", 0.99)])
def test_the_stand_in_clips_alpha_as_its_version_does(kind: str, largest: float) -> None:
    """docs/gpu.md names the limits; nothing else may depend on them."""
    on_axis = Camera(40.0, 40.0, 8.5, 8.5, 17, 17, np.eye(4))
    rows = ([[0.0, 0.0, 4.0]], [[1.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [12.0], [[1.0]])
    _, _, alpha = backend_of(kind).rasterize(*(torch.tensor(row) for row in rows), on_axis, 1)
    assert float(alpha[8, 8]) == pytest.approx(largest, abs=1e-5)


def test_tiles_are_listed_by_ellipses_where_gsplat_knows_them() -> None:
    """Long thin splats across the picture: from 1.6 on, tiles of their boxes that they do not reach are left out."""
    library = TorchSplatting16()
    p = parameters(GsplatBackend(torch.device("cpu"), library))
    with torch.no_grad():
        p["log_scales"] += torch.tensor([1.5, -1.5, -1.5])
    with_ellipses = GsplatBackend(torch.device("cpu"), library).rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    by_boxes = TorchSplatting(holder=True)
    expected = GsplatBackend(torch.device("cpu"), by_boxes).rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    assert library.listed < library.boxed
    for found, wanted in zip(with_ellipses, expected, strict=True):
        torch.testing.assert_close(found, wanted)


PROJECTION = (
    "(means, covars, quats, scales, viewmats, Ks, width, height, eps2d=0.3, near_plane=0.01, far_plane=10000000000.0, "
    "radius_clip=0.0, packed=False, sparse_grad=False, calc_compensations=False, camera_model='pinhole', "
    "opacities=None)"
)
TILES = (
    "(means2d, radii, depths, tile_size, tile_width, tile_height, sort=True, segmented=False, packed=False, "
    "n_images=None, image_ids=None, gaussian_ids=None{})"
)
OFFSETS = "(isect_ids, n_images, tile_width, tile_height)"
PIXELS = (
    "(means2d, conics, colors, opacities, image_width, image_height, tile_size, isect_offsets, flatten_ids, "
    "backgrounds=None, masks=None, packed=False, absgrad=False)"
)
SIGNATURES = {
    version: {
        "fully_fused_projection": PROJECTION,
        "isect_tiles": TILES.format(of_tiles),
        "isect_offset_encode": OFFSETS,
        "rasterize_to_pixels": PIXELS,
    }
    for version, of_tiles in {"1.5.3": "", "1.6.0": ", conics=None, opacities=None"}.items()
}
"""Those of gsplat's `gsplat/cuda/_wrapper` in both versions, without annotations."""


@pytest.mark.parametrize("kind", ["like 1.5", "like 1.6", GPU])
def test_calls_are_made_as_gsplat_wants_them(kind: str) -> None:
    """The stand-in takes what the real versions take, and nothing else; a gsplat that changes shows here."""
    library = backend_of(kind)._library
    expected = SIGNATURES["1.6.0" if library.__version__ >= "1.6" else "1.5.3"]
    for name, signature in expected.items():
        found = inspect.signature(getattr(library, name))
        plain = [value.replace(annotation=inspect.Parameter.empty) for value in found.parameters.values()]
        assert str(inspect.Signature(plain)) == signature, name
