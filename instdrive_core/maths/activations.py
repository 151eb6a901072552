"""The activations between stored (raw) and physical Gaussian parameters (3DGS, Kerbl et al. 2023)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray


def sigmoid(logits: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """Compute opacities in (0, 1) from their logits; never overflows."""
    return 0.5 * (1.0 + np.tanh(0.5 * logits))


def logit(probabilities: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """Compute logits, the inverse of `sigmoid`; probabilities are clipped to [1e-6, 1 - 1e-6]."""
    clipped = np.clip(probabilities, 1e-6, 1.0 - 1e-6)
    return np.log(clipped / (1.0 - clipped))
