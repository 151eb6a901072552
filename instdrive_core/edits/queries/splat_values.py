"""Numbers of splats that one can select by: opacity, size, shape, distance, colour, and further columns of the file."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.isolation import find_isolated
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.wording import phrase

"""The distance to this neighbour says how alone a splat is."""


@dataclass(frozen=True)
class Viewing:
    """From where, and when, values are asked for."""

    position: Float64[ndarray, "3"]
    """The camera's, metres."""
    time: float
    """Seconds."""


@dataclass(frozen=True)
class SplatValue:
    """A number that every splat has."""

    name: str
    title: str
    unit: str
    compute: Callable[[Document, Viewing], Float32[ndarray, " n"]]
    is_logarithmic: bool = False
    """Whether sizes spread over magnitudes, so that a logarithmic axis shows them better."""


def _find_opacity(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    return document.scene.gaussians.opacities.astype(np.float32)


def _find_size(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    return np.exp(document.scene.gaussians.log_scales.max(axis=1))


def _find_thinness(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    return np.exp(document.scene.gaussians.log_scales.min(axis=1))


def _find_elongation(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    scales = document.scene.gaussians.log_scales
    longest, shortest = scales.max(axis=1), scales.min(axis=1)
    return np.exp(np.minimum(2 * longest + shortest - scales.sum(axis=1), 30))


def _find_distance(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    means, _ = compute_shown_means(document, viewing.time)
    return np.linalg.norm(means - viewing.position.astype(np.float32), axis=1)


def _find_height(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    return compute_shown_means(document, viewing.time)[0][:, 2].astype(np.float32)


def _find_brightness(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    return find_plain_colors(document) @ np.array([0.2126, 0.7152, 0.0722], np.float32)


def _find_saturation(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    colors = find_plain_colors(document)
    return np.ptp(colors, axis=1) / np.maximum(colors.max(axis=1), np.float32(1e-6))


def _find_hue(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
    red, green, blue = find_plain_colors(document).T
    degrees = np.degrees(np.arctan2(np.sqrt(np.float32(3)) * (green - blue), 2 * red - green - blue))
    return np.mod(degrees, 360).astype(np.float32)


SPLAT_VALUES: tuple[SplatValue, ...] = (
    SplatValue("opacity", "Opacity", "", _find_opacity),
    SplatValue("size", "Size (longest axis)", "m", _find_size, is_logarithmic=True),
    SplatValue("thinness", "Thickness (shortest axis)", "m", _find_thinness, is_logarithmic=True),
    SplatValue("elongation", "Length to width", "", _find_elongation, is_logarithmic=True),
    SplatValue("distance", "Distance from the camera", "m", _find_distance),
    SplatValue("height", "Height", "m", _find_height),
    SplatValue("brightness", "Brightness", "", _find_brightness),
    SplatValue("saturation", "Saturation", "", _find_saturation),
    SplatValue("hue", "Hue", "°", _find_hue),
)
"""What every scene has."""


def list_splat_values(document: Document) -> tuple[SplatValue, ...]:
    """List what splats of this document can be selected by: `SPLAT_VALUES`, and each further column of its file."""
    return (*SPLAT_VALUES, *(_make_column_value(name) for name in sorted(document.scene.extra)))


def find_plain_colors(document: Document) -> Float32[ndarray, "n 3"]:
    """Find the colours of all splats as they were trained, without view dependence: 0 … 1, not below black."""
    return np.maximum(color_from_dc(document.scene.gaussians.sh_dc), 0).astype(np.float32)


def find_rows_in_range(values: Float[ndarray, " n"], low: float, high: float) -> Int64[ndarray, " m"]:
    """Find the rows whose value is from `low` to `high`; what is not a number is in no range."""
    return np.flatnonzero((values >= low) & (values <= high))


@dataclass(frozen=True)
class FloaterLimits:
    """What makes a splat a floater; 0 leaves a kind out."""

    isolation: float = 6.0
    """Times the usual distance to the sixth neighbour."""
    thickness: float = 0.0
    """Metres of the shortest axis below which a splat is thin."""
    opacity: float = 0.03
    """Opacity below which a splat is faint."""
    elongation: float = 30.0
    """Length to width above which a splat is a needle."""


def find_scene_floaters(document: Document, limits: FloaterLimits) -> Int64[ndarray, " m"]:
    """Find what is isolated, thin, faint or needle-like anywhere in the scene; a million splats take some seconds.

    Splats that are deleted count neither as floaters nor as neighbours.
    """
    still = Viewing(np.zeros(3), 0.0)
    means, drawn = compute_shown_means(document, 0.0)
    found = np.zeros(len(means), np.bool_)
    if limits.thickness > 0:
        found |= _find_thinness(document, still) < limits.thickness
    if limits.opacity > 0:
        found |= _find_opacity(document, still) < limits.opacity
    if limits.elongation > 0:
        found |= _find_elongation(document, still) > limits.elongation
    if limits.isolation > 0:
        others = max(1, (os.cpu_count() or 1) - 1)  # one core is left to the window, which draws meanwhile
        found[drawn] |= find_isolated(means[drawn], limits.isolation, others)
    return np.flatnonzero(found & drawn)


def _make_column_value(name: str) -> SplatValue:
    def compute(document: Document, viewing: Viewing) -> Float32[ndarray, " n"]:
        return document.scene.extra[name].astype(np.float32)

    return SplatValue(f"column {name}", phrase("Column {name}", name=name), "", compute)
