"""How drivestudio's deformable things bend: a network from position, time and the thing's embedding to offsets.

Positions and time enter as themselves with sines and cosines of 2^0 … 2^(k-1) times them; all layers but the last are
followed by ReLU, and the input enters again before the layer after the middle one (Yang et al. 2024, "Deformable 3D
Gaussians", conditioned on an embedding per thing).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_BLOCK_ROWS = 1 << 14
_MOST_LAYERS, _MOST_WIDTH = 32, 4096


@dataclass(frozen=True)
class BendingNetwork:
    """Weights of the layers, and of what reads offsets from the last of them."""

    layers: tuple[tuple[ndarray, ndarray], ...]
    heads: Mapping[str, tuple[ndarray, ndarray]]
    """``gaussian_warp`` and perhaps ``gaussian_rotation``, ``gaussian_scaling``."""
    frequencies: int

    def compute_offsets(
        self, points: Float[ndarray, "n 3"], time: float, embeddings: Float[ndarray, "n e"]
    ) -> dict[str, ndarray]:
        """Compute what each head gives at points (in half heights of their thing) and a time in [0, 1]."""
        parts = []
        for start in range(0, len(points), _BLOCK_ROWS):
            rows = slice(start, start + _BLOCK_ROWS)
            block = points[rows]
            times = np.full((len(block), 1), time, np.float32)
            given = [_encode_waves(block, self.frequencies), _encode_waves(times, self.frequencies), embeddings[rows]]
            parts.append(self._run(np.concatenate(given, axis=1)))
        return {name: np.concatenate([part[name] for part in parts]) for name in self.heads}

    def _run(self, given: ndarray) -> dict[str, ndarray]:
        hidden = given
        for number, (weight, bias) in enumerate(self.layers):
            hidden = np.maximum(hidden @ weight.T + bias, 0)
            if number == len(self.layers) // 2:
                hidden = np.concatenate([given, hidden], axis=1)
        return {name: hidden @ weight.T + bias for name, (weight, bias) in self.heads.items()}


def build_bending_network(tensors: Mapping[str, ndarray], embedding: int) -> BendingNetwork:
    """Build the network from its tensors. Raises ValueError where they do not fit each other.

    Args:
        tensors: ``linear.0.weight`` … and the heads' weights and biases.
        embedding: numbers of a thing's embedding.
    """
    layers = []
    while f"linear.{len(layers)}.weight" in tensors and len(layers) < _MOST_LAYERS:
        layers.append(_pair(tensors, f"linear.{len(layers)}"))
    heads = {name: _pair(tensors, name) for name in _HEAD_SIZES if f"{name}.weight" in tensors}
    if not layers or "gaussian_warp" not in heads:
        raise ValueError("its network has no layers, or gives no positions")
    given = layers[0][0].shape[1]
    # A position and a time: 4 numbers, and 2 more of each per frequency.
    frequencies, rest = divmod(given - embedding - 4, 8)
    if rest or not 0 <= frequencies <= 24:
        raise ValueError(f"its network takes {given} numbers, which fits no number of frequencies")
    width = given
    for number, (weight, _) in enumerate(layers):
        if weight.shape[1] != width:
            raise ValueError(f"layer {number} of its network takes {weight.shape[1]} numbers, not {width}")
        width = len(weight) + (given if number == len(layers) // 2 else 0)
    if any(weight.shape != (_HEAD_SIZES[name], width) for name, (weight, _) in heads.items()):
        raise ValueError("what its network gives has another shape")
    return BendingNetwork(tuple(layers), heads, frequencies)


_HEAD_SIZES = {"gaussian_warp": 3, "gaussian_rotation": 4, "gaussian_scaling": 3}


def _pair(tensors: Mapping[str, ndarray], name: str) -> tuple[ndarray, ndarray]:
    weight, bias = tensors[f"{name}.weight"], tensors.get(f"{name}.bias")
    if bias is None or weight.ndim != 2 or bias.shape != weight.shape[:1] or max(weight.shape) > _MOST_WIDTH:
        raise ValueError(f"{name} of its network has weights of shape {weight.shape}")
    return weight, bias


def _encode_waves(values: Float[ndarray, "n d"], frequencies: int) -> Float[ndarray, "n w"]:
    waves = [values]
    for power in range(frequencies):
        waves += [np.sin(values * 2.0**power), np.cos(values * 2.0**power)]
    return np.concatenate(waves, axis=1).astype(np.float32)
