"""Lenses of requests that are no pinholes: OpenCV's with distortion and fisheye, and f-theta."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.rasterize.lens import LensRays
from instdrive_core.serving.messages import find_message_class
from instdrive_core.serving.requests import RequestError, require_between

WIDEST = np.radians(125.0)
"""Angle off the axis beyond which a pixel sees nothing."""
_FOCAL = (1.0, 1e6)
_MOST_COEFFICIENTS = 16
_LARGEST = 1e9
_TABLE = 4096
"""Angles at which a lens is tabled."""
_ROUNDS = 30
_MET = 1e-4
"""How near distortion must come to a pixel, in focal lengths, for the pixel to see anything."""
_KEPT = 8
"""Lenses whose rays are kept."""

Offsets = Float64[ndarray, "p 2"]


def trace_lens(spec: Any, size: tuple[int, int]) -> LensRays:
    """Trace where the pixels of a request's lens look.

    Args:
        spec: CameraSpec message whose lens is no pinhole without distortion; its resolution has been checked.
        size: width and height of the picture, to which the lens is scaled.

    Raises RequestError naming the field that is wrong.
    """
    return _trace(spec.SerializeToString(deterministic=True), size)


@lru_cache(maxsize=_KEPT)
def _trace(packed: bytes, size: tuple[int, int]) -> LensRays:
    spec = find_message_class("CameraSpec").FromString(packed)
    kind = spec.WhichOneof("camera_param")
    lens, field = getattr(spec, kind), f"camera_intrinsics.{kind}"
    across, down = spec.resolution_w, spec.resolution_h
    center = [
        require_between(f"{field}.principal_point_x", lens.principal_point_x, -across, 2 * across),
        require_between(f"{field}.principal_point_y", lens.principal_point_y, -down, 2 * down),
    ]
    columns = (np.arange(size[0]) + 0.5) * across / size[0] - center[0]
    rows = (np.arange(size[1]) + 0.5) * down / size[1] - center[1]
    offsets = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    find = {
        "ftheta_param": _find_ftheta,
        "opencv_fisheye_param": _find_fisheye,
        "opencv_pinhole_param": _find_undistorted,
    }[kind]
    directions = find(lens, field, offsets)
    seen = np.asarray(np.isfinite(directions).all(axis=1))
    if not seen.any():
        raise RequestError(field, "a lens of which no pixel sees anything", "send another one")
    directions[~seen] = [0, 0, 1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shape = (size[1], size[0])
    return LensRays(directions.reshape(*shape, 3).astype(np.float32), seen.reshape(shape))


def _find_ftheta(lens: Any, field: str, offsets: Offsets) -> Float64[ndarray, "p 3"]:
    if lens.HasField("linear_cde"):
        c, d, e = (
            require_between(f"{field}.linear_cde.linear_{name}", getattr(lens.linear_cde, f"linear_{name}"), -10, 10)
            for name in "cde"
        )
        if abs(c - d * e) < 0.01:
            raise RequestError(f"{field}.linear_cde", f"({c:g}, {d:g}, {e:g})", "send numbers with c - d e above 0.01")
        offsets = offsets @ np.linalg.inv([[c, d], [e, 1.0]]).T
    radii, widest = np.linalg.norm(offsets, axis=1), _read_widest(lens, field)
    backward = _read_numbers(lens, field, "pixeldist_to_angle_poly")
    forward = _read_numbers(lens, field, "angle_to_pixeldist_poly")
    if len(backward) and (lens.reference_poly == 1 or not len(forward)):
        angles = np.polynomial.polynomial.polyval(radii, backward)
    elif len(forward):
        angles = _invert(lambda angle: np.polynomial.polynomial.polyval(angle, forward), radii, widest)
    else:
        remedy = "send angle_to_pixeldist_poly or pixeldist_to_angle_poly"
        raise RequestError(f"{field}.angle_to_pixeldist_poly", "empty", remedy)
    return _bend(offsets, radii, angles, widest)


def _find_fisheye(lens: Any, field: str, offsets: Offsets) -> Float64[ndarray, "p 3"]:
    offsets = offsets / _read_focal(lens, field)
    series = _read_numbers(lens, field, "radial_coeffs")
    radii, widest = np.linalg.norm(offsets, axis=1), _read_widest(lens, field)
    odd = np.zeros(2 * len(series) + 2)
    odd[1::2] = [1.0, *series]
    angles = _invert(lambda angle: np.polynomial.polynomial.polyval(angle, odd), radii, widest)
    return _bend(offsets, radii, angles, widest)


def _find_undistorted(lens: Any, field: str, offsets: Offsets) -> Float64[ndarray, "p 3"]:
    """Directions whose distorted places are the pixels, by going on until they meet."""
    goal = offsets / _read_focal(lens, field)
    k, p, s = (
        np.resize(np.r_[_read_numbers(lens, field, name), np.zeros(count)], count)
        for name, count in (("radial_coeffs", 6), ("tangential_coeffs", 2), ("thin_prism_coeffs", 4))
    )
    places = goal.copy()
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            places += goal - _distort(places, k, p, s)
        missed = np.linalg.norm(_distort(places, k, p, s) - goal, axis=1)
    places[~(missed < _MET)] = np.nan
    return np.c_[places, np.ones(len(places))]


def _distort(places: Offsets, k: ndarray, p: ndarray, s: ndarray) -> Offsets:
    """OpenCV's model with six radial, two tangential and four thin prism coefficients."""
    x, y = places.T
    r2 = x * x + y * y
    factor = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (1 + r2 * (k[3] + r2 * (k[4] + r2 * k[5])))
    return np.stack(
        [
            x * factor + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x) + r2 * (s[0] + r2 * s[1]),
            y * factor + p[0] * (r2 + 2 * y * y) + 2 * p[1] * x * y + r2 * (s[2] + r2 * s[3]),
        ],
        axis=1,
    )


def _invert(find_radius: Callable[[ndarray], ndarray], radii: ndarray, widest: float) -> ndarray:
    """Angles at which a lens reaches radii; NaN beyond its edge, or beyond where it folds back."""
    angles = np.linspace(0, widest, _TABLE)
    tabled = find_radius(angles)
    rising = np.flatnonzero(~(np.diff(tabled) > 0))
    end = int(rising[0]) + 1 if len(rising) else _TABLE
    return np.interp(radii, tabled[:end], angles[:end], right=np.nan)


def _bend(offsets: Offsets, radii: ndarray, angles: ndarray, widest: float) -> Float64[ndarray, "p 3"]:
    """Directions at angles off the axis, towards offsets; NaN where there are none."""
    angles = np.where((angles >= 0) & (angles <= widest), angles, np.nan)
    towards = offsets / np.maximum(radii, 1e-12)[:, None]
    return np.c_[towards * np.sin(angles)[:, None], np.cos(angles)]


def _read_widest(lens: Any, field: str) -> float:
    if not lens.max_angle:
        return float(WIDEST)
    return min(require_between(f"{field}.max_angle", lens.max_angle, 0.01, 10), float(WIDEST))


def _read_focal(lens: Any, field: str) -> tuple[float, float]:
    return (
        require_between(f"{field}.focal_length_x", lens.focal_length_x, *_FOCAL),
        require_between(f"{field}.focal_length_y", lens.focal_length_y, *_FOCAL),
    )


def _read_numbers(lens: Any, field: str, name: str) -> Float64[ndarray, " c"]:
    values = list(getattr(lens, name))
    if len(values) > _MOST_COEFFICIENTS:
        raise RequestError(f"{field}.{name}", f"{len(values)} long", f"send at most {_MOST_COEFFICIENTS} numbers")
    for place, value in enumerate(values):
        require_between(f"{field}.{name}[{place}]", value, -_LARGEST, _LARGEST)
    return np.array(values, np.float64)
