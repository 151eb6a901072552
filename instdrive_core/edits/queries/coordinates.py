"""Where the coordinates of one scene lie in another: both say where in the world their origin is."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.scene import Scene

FARTHEST_MIDDLE = 1000.0
"""Metres from the middle of a scene to that of another that lies in the same coordinates."""


def measure_offset(document: Document, source: Scene) -> Float64[ndarray, "3"]:
    """Measure the metres by which a scene has to be moved to lie where its coordinates have it.

    Only a document that was not turned or scaled still has its axes.
    """
    return source.origin - document.scene.origin


def measure_distance(document: Document, source: Scene, middle: Float[ndarray, "3"]) -> float:
    """Measure the metres between the middles of a document and of a scene that lies where its coordinates have it."""
    means = document.scene.gaussians.means
    own = np.median(means[:: max(1, len(means) // 10_000)], axis=0).astype(np.float64) if len(means) else np.zeros(3)
    return float(np.linalg.norm(middle + measure_offset(document, source) - own))
