"""3D Gaussians as a struct of arrays, stored raw as in the INRIA .ply."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import REST_COUNTS


@dataclass
class Gaussians:
    """N Gaussians, float32. Raises ValueError where a shape does not fit."""

    means: Float32[ndarray, "n 3"]
    """Metres, relative to the scene's origin; for an actor's Gaussians, in the actor's box frame."""
    quats: Float32[ndarray, "n 4"]
    """wxyz, of any length above 0."""
    log_scales: Float32[ndarray, "n 3"]
    """Natural logarithm of the standard deviations in metres."""
    opacity_logits: Float32[ndarray, " n"]
    sh_dc: Float32[ndarray, "n 3"]
    sh_rest: Float32[ndarray, "n k 3"]
    """k = 0, 3, 8 or 15 (SH degree 0 … 3)."""
    features: Float32[ndarray, "n d"]
    """Instance features; d may be 0."""

    def __post_init__(self) -> None:
        count = len(self.means)
        tails = {"means": (3,), "quats": (4,), "log_scales": (3,), "opacity_logits": (), "sh_dc": (3,)}
        for name, tail in tails.items():
            if getattr(self, name).shape != (count, *tail):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {(count, *tail)}")
        rest, features = self.sh_rest.shape, self.features.shape
        if len(rest) != 3 or rest[0] != count or rest[1] not in REST_COUNTS or rest[2] != 3:
            raise ValueError(f"sh_rest has shape {rest}, expected ({count}, 0|3|8|15, 3)")
        if len(features) != 2 or features[0] != count:
            raise ValueError(f"features has shape {features}, expected ({count}, d)")
        for entry in fields(self):
            setattr(self, entry.name, np.ascontiguousarray(getattr(self, entry.name), dtype=np.float32))

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """SH degree, 0 … 3."""
        return REST_COUNTS.index(self.sh_rest.shape[1])

    @property
    def opacities(self) -> Float32[ndarray, " n"]:
        """Opacities in (0, 1)."""
        return sigmoid(self.opacity_logits)

    @property
    def scales(self) -> Float32[ndarray, "n 3"]:
        """Standard deviations in metres."""
        return np.exp(self.log_scales)

    def arrays(self) -> dict[str, ndarray]:
        """Return every array by its name, not copied."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    def select(self, rows: ndarray | slice) -> Gaussians:
        """Select the Gaussians of an index array, mask or slice."""
        return Gaussians(**{name: array[rows] for name, array in self.arrays().items()})

    def copy(self) -> Gaussians:
        """Copy all arrays."""
        return Gaussians(**{name: array.copy() for name, array in self.arrays().items()})


def concatenate_gaussians(parts: list[Gaussians]) -> Gaussians:
    """Join parts in order; their SH degrees and feature dimensions must agree."""
    names = [entry.name for entry in fields(Gaussians)]
    return Gaussians(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def create_empty_gaussians(sh_rest_count: int = 0, feature_dim: int = 0) -> Gaussians:
    """Create zero Gaussians with the given column counts."""
    shapes = [(0, 3), (0, 4), (0, 3), (0,), (0, 3), (0, sh_rest_count, 3), (0, feature_dim)]
    return Gaussians(*(np.zeros(shape, np.float32) for shape in shapes))
