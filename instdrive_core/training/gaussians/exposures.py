"""Learnable exposures: one affine change of colour per training photo, held near the identity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from instdrive_core.scene.exposure import Exposures


@runtime_checkable
class TimedPhoto(Protocol):
    """A photo with a name and a time; a training view is one."""

    @property
    def key(self) -> str:
        """``camera_name/NN``."""
        ...

    @property
    def time(self) -> float:
        """Seconds."""
        ...


def make_initial_exposures(count: int) -> Float[Tensor, "v 3 4"]:
    """Make the identity (3, 4) for each of `count` photos."""
    return torch.eye(3, 4).repeat(count, 1, 1)


def exposure_penalty(exposures: Float[Tensor, "v 3 4"], photo: int) -> Float[Tensor, ""]:
    """Cost of one photo's exposure: its mean squared distance to the identity mirrored at the mean.

    With e_i the distances of all V exposures from the identity and ē their mean, steps over all photos descend
    Σ |e_i|² + V |ē|². A change common to all photos could as well be in the Gaussians and the sky; the second term puts
    it there, so that the scene drawn without exposure looks like the photos' average. The gradient reaches this photo
    only.
    """
    identity = torch.eye(3, 4, device=exposures.device)
    mean = exposures.detach().mean(dim=0) - identity
    return (exposures[photo] - identity + mean).square().mean()


def export_exposures(exposures: Float[Tensor, "v 3 4"], photos: Sequence[TimedPhoto]) -> Exposures:
    """Export the exposures in the form that a scene carries; row i belongs to `photos[i]`."""
    keys, times = tuple(photo.key for photo in photos), np.array([photo.time for photo in photos], np.float64)
    return Exposures(keys, times, exposures.detach().cpu().numpy().astype(np.float32))
