"""One sky for all pieces: each direction takes the colours of the pieces that saw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.scene.sky import Sky
from instdrive_core.scene.sky_fill import SEEN, UNSEEN, fill_unseen_sky


@dataclass(frozen=True)
class SeenSky:
    """The sky of one piece and what its photos saw of it."""

    sky: Sky
    evidence: Float32[ndarray, "6 r r"]
    """Largest share of light, 0 … 1, that reached a photo from each texel."""


def join_skies(parts: Sequence[SeenSky]) -> Sky | None:
    """Average skies of one resolution by what was seen of them, and fill what no piece saw; None without any."""
    if not parts:
        return None
    evidence = np.stack([part.evidence for part in parts])
    weights = np.clip((evidence - UNSEEN) / (SEEN - UNSEEN), 0, 1) + np.float32(1e-3)
    faces = np.stack([part.sky.faces for part in parts])
    mean = (weights[..., None] * faces).sum(axis=0) / weights.sum(axis=0)[..., None]
    return fill_unseen_sky(Sky(mean.astype(np.float32)), evidence.max(axis=0))
