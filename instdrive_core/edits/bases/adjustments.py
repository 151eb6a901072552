"""Adjustments of colour as affine maps of RGB: what multiplies a colour may be applied to its SH rest as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.edits.bases.parameters import check_number
from instdrive_core.errors import EditError
from instdrive_core.wording import phrase

LUMA = np.array([0.2126, 0.7152, 0.0722])
"""Rec. 709 weights of R, G, B."""
AdjustKind = Literal["hue", "brightness", "contrast", "saturation", "temperature", "opacity"]
TEMPERATURE_STOPS = 0.5
"""At temperature 1 red is multiplied by 2 to this power, blue divided by it."""


class Range(NamedTuple):
    """The amounts that an adjustment may have."""

    low: float
    high: float
    neutral: float
    """The amount that changes nothing."""


NAMES: dict[AdjustKind, str] = {
    "hue": phrase("hue"),
    "brightness": phrase("brightness"),
    "contrast": phrase("contrast"),
    "saturation": phrase("saturation"),
    "temperature": phrase("temperature"),
    "opacity": phrase("opacity"),
}
"""How titles of edits name what is adjusted."""
RANGES: dict[AdjustKind, Range] = {
    "hue": Range(-180.0, 180.0, 0.0),
    "brightness": Range(0.0, 4.0, 1.0),
    "contrast": Range(0.0, 4.0, 1.0),
    "saturation": Range(0.0, 4.0, 1.0),
    "temperature": Range(-1.0, 1.0, 0.0),
    "opacity": Range(0.0, 1.0, 1.0),
}
"""Hue in degrees; temperature from cool to warm; the others are factors."""


def check_adjustment(kind: AdjustKind, amount: float) -> float:
    """The amount as a float. Raises EditError where there is no such adjustment, or its range has no such amount."""
    if kind not in get_args(AdjustKind):
        raise EditError(
            phrase("adjustment {kind!r} is not one of {list}", kind=kind, list=", ".join(get_args(AdjustKind)))
        )
    amount = check_number(amount, "amount")
    low, high, _ = RANGES[kind]
    if not low <= amount <= high:
        raise EditError(
            phrase("{kind} {amount:g} is not from {low:g} to {high:g}", kind=kind, amount=amount, low=low, high=high)
        )
    return amount


def compute_adjustment(kind: AdjustKind, amount: float, mean: Float[ndarray, "3"]) -> Float64[ndarray, "3 4"]:
    """[M | c] with colour' = M colour + c; the identity for `opacity`.

    Hue and saturation keep the luma of every colour, so light and shade stay; temperature keeps that of greys; contrast
    is the distance from the `mean` colour.
    """
    matrix = np.eye(3, 4)
    if kind == "hue":
        matrix[:, :3] = compute_hue_rotation(amount)
    elif kind == "saturation":
        gray = np.tile(LUMA, (3, 1))
        matrix[:, :3] = gray + amount * (np.eye(3) - gray)
    elif kind == "temperature":
        gains = 2.0 ** (TEMPERATURE_STOPS * amount * np.array([1.0, 0.0, -1.0]))
        matrix[:, :3] = np.diag(gains / (LUMA @ gains))
    elif kind in ("brightness", "contrast"):
        matrix[:, :3] *= amount
        matrix[:, 3] = (1 - amount) * np.asarray(mean) if kind == "contrast" else 0
    return matrix


def compute_hue_rotation(degrees: float) -> Float64[ndarray, "3 3"]:
    """Rotation of hue that leaves greys and every colour's luma as they are; red turns towards green."""
    return compute_hue_rotations(np.array([degrees], np.float64))[0]


def compute_hue_rotations(degrees: Float64[ndarray, " k"]) -> Float64[ndarray, "k 3 3"]:
    """The rotations of k hues.

    With L the projection to grey along the plane of equal luma and J the cross product with the unit grey axis,
    K = (I - L) J has K² = -(I - L), so L + cos(h) (I - L) + sin(h) K is a rotation within planes of equal luma.
    """
    angles = np.deg2rad(degrees)[:, None, None]
    gray = np.tile(LUMA, (3, 1))
    cross = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]) / np.sqrt(3)
    rest = np.eye(3) - gray
    return gray + np.cos(angles) * rest + np.sin(angles) * (rest @ cross)


def compute_hue(color: Sequence[float] | Float[ndarray, "3"]) -> float:
    """Hue in degrees, as `compute_hue_rotation` turns it: 0 = red, 120 = green; 0 for greys."""
    return float(compute_hues(np.array([color], np.float64))[0])


def compute_hues(colors: Float64[ndarray, "k 3"]) -> Float64[ndarray, " k"]:
    """The hues of k colours."""
    red, green, blue = colors.T
    return np.rad2deg(np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue))
