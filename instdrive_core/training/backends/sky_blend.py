"""The sky behind the Gaussians for torch: image + (1 - alpha) · sky(direction), with gradients to all three."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.kernels import sky_behind
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.sky import Sky


def composite_over_sky(
    image: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"], faces: Float[Tensor, "6 r r 3"], camera: Camera
) -> Float[Tensor, "h w 3"]:
    """Composite the cube map (see `scene/sky.py`) behind a rendered image."""
    return _OverSky.apply(image, alpha, faces, camera)


class _OverSky(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image: Tensor, alpha: Tensor, faces: Tensor, camera: Camera) -> Tensor:
        ctx.save_for_backward(alpha, faces)
        ctx.camera = camera
        arrays = image.detach().numpy(), alpha.detach().numpy()
        return torch.from_numpy(sky_behind.copy_over_sky(Sky(faces.detach().numpy()), camera, *arrays))

    @staticmethod
    @once_differentiable
    def backward(ctx, grad: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        alpha, faces = (tensor.detach().numpy() for tensor in ctx.saved_tensors)
        grad_alpha, grad_faces = sky_behind.render_sky_behind_backward(Sky(faces), ctx.camera, alpha, grad.numpy())
        return grad, torch.from_numpy(grad_alpha), torch.from_numpy(grad_faces), None
