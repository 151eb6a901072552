"""Every optimiser of a run: Adam on what a view touched, for Gaussians as for photos and tracks."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Int64
from numpy import ndarray
from torch import Tensor

from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.gaussians.view_rendering import GEOMETRY
from instdrive_core.training.gaussians.visible_adam import VisibleAdam
from instdrive_core.training.settings.config import TrainConfig

_SKY_EPS = 1e-8
"""Texels that photos hardly touch stay as they are, instead of taking full steps along rounding errors."""


class Optimizers:
    """Adam for each kind of parameter; rows without gradient keep their values and moments."""

    def __init__(self, model: SceneModel, config: TrainConfig, by_kernels: bool = True) -> None:
        """
        Args:
            by_kernels: as for `VisibleAdam`.
        """
        geometry, p, shared = config.geometry, model.parameters, model.shared
        self.track_decay = geometry.track_decay
        self.geometry = VisibleAdam(
            {name: p[name] for name in GEOMETRY},
            {
                "means": geometry.means_lr,
                "quats": geometry.rotation_lr,
                "log_scales": geometry.scale_lr,
                "opacity_logits": geometry.opacity_lr,
                "sh_dc": geometry.sh_dc_lr,
                "sh_rest": geometry.sh_rest_lr,
            },
            by_kernels=by_kernels,
        )
        self.features = (
            VisibleAdam({"features": p["features"]}, {"features": config.instances.feature_lr}, by_kernels=by_kernels)
            if p["features"].shape[1]
            else None
        )
        """None where Gaussians have no features, as where votes learn instances: no moments, no counts."""
        self.tracks = VisibleAdam(
            model.corrections, dict.fromkeys(model.corrections, geometry.track_lr), by_kernels=by_kernels
        )
        self.exposures = VisibleAdam(
            {"exposures": shared["exposures"]}, {"exposures": geometry.exposure_lr}, by_kernels=by_kernels
        )
        self.sky = torch.optim.Adam([shared["sky"]], lr=geometry.sky_lr, eps=_SKY_EPS, fused=True)

    def step_shared(self, model: SceneModel) -> None:
        """Descend sky, exposures and tracks along the gradients that the last backward pass left, and clear these.

        Corrections of tracks also shrink where they were touched, apart from Adam's scaling (Loshchilov & Hutter 2019):
        each pose is seen too seldom for a penalty in the loss to be weighed against the gradient.
        """
        self.sky.step()
        _step_touched(self.exposures, {"exposures": model.shared["exposures"]}, 0.0)
        _step_touched(self.tracks, model.corrections, self.track_decay)
        for tensor in model.shared.values():
            tensor.grad = None

    def rearrange(self, parents: Int64[ndarray, " m"], fresh: Bool[ndarray, " m"], model: SceneModel) -> None:
        """Rearrange the optimisers' rows as the model's after Gaussians were added and removed."""
        p = model.parameters
        self.geometry = self.geometry.rearrange(parents, fresh, {name: p[name] for name in GEOMETRY})
        if self.features is not None:
            self.features = self.features.rearrange(parents, fresh, {"features": p["features"]})

    def state_tensors(self) -> dict[str, Tensor]:
        """Tensors that a resumed run needs, by name."""
        tensors: dict[str, Tensor] = {}
        for group, optimizer in self._groups().items():
            tensors |= {f"{group}.{name}": value for name, value in optimizer.state_tensors().items()}
        for state in self.sky.state.values():
            tensors |= {f"sky.{name}": state[name] for name in ("exp_avg", "exp_avg_sq", "step")}
        return tensors

    def load_state_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Take over what `state_tensors` gave, by value; each tensor goes to its parameter's device."""
        for group, optimizer in self._groups().items():
            optimizer.load_state_tensors(_within(tensors, group))
        sky = _within(tensors, "sky")
        if sky:
            faces = self.sky.param_groups[0]["params"][0]
            self.sky.state[faces] = {name: value.to(faces.device, copy=True) for name, value in sky.items()}

    def _groups(self) -> dict[str, VisibleAdam]:
        groups = {
            "geometry": self.geometry,
            "features": self.features,
            "tracks": self.tracks,
            "exposures": self.exposures,
        }
        return {name: optimizer for name, optimizer in groups.items() if optimizer is not None}


def _step_touched(optimizer: VisibleAdam, parameters: dict[str, Tensor], decay: float) -> None:
    gradients = {name: value.grad for name, value in parameters.items()}
    known = [grad for grad in gradients.values() if grad is not None]
    if not known:
        return
    touched = torch.stack([grad.flatten(1).ne(0).any(dim=1) for grad in known]).any(dim=0)
    optimizer.step(torch.arange(len(touched), device=touched.device), gradients, touched)
    if not decay:
        return
    with torch.no_grad():
        for value in parameters.values():
            value -= torch.where(touched[:, None], decay * value, 0)


def _within(tensors: dict[str, Tensor], group: str) -> dict[str, Tensor]:
    return {name.removeprefix(group + "."): value for name, value in tensors.items() if name.startswith(group + ".")}
