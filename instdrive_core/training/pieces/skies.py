"""One sky for all pieces: each direction takes the colours of the pieces that saw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from instdrive_core.scene.sky import Sky
from instdrive_core.scene.sky_fill import SEEN, UNSEEN, SkyEvidence, fill_unseen_sky


@dataclass(frozen=True)
class SeenSky:
    """The sky of one piece and what its photos saw of it."""

    sky: Sky
    evidence: SkyEvidence


def join_skies(parts: Sequence[SeenSky]) -> Sky | None:
    """Average skies of one resolution by what was seen of them, and fill what no piece saw; None without any."""
    if not parts:
        return None
    light = np.stack([part.evidence.light for part in parts])
    grounds = [part.evidence.ground for part in parts if part.evidence.ground is not None]
    weights = np.clip((light - UNSEEN) / (SEEN - UNSEEN), 0, 1) + np.float32(1e-3)
    faces = np.stack([part.sky.faces for part in parts])
    mean = (weights[..., None] * faces).sum(axis=0) / weights.sum(axis=0)[..., None]
    joined = SkyEvidence(light.max(axis=0), np.mean(grounds, axis=0) if grounds else None)
    return fill_unseen_sky(Sky(mean.astype(np.float32)), joined)
