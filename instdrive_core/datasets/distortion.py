"""Lens distortion, and its removal from photos: everything after this sees a pinhole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.fisheye import Fisheye
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class Distortion:
    """Brown's model as OpenCV and COLMAP write it, on coordinates x/z, y/z with r² = x² + y².

    The radial factor is (1 + Σ radial[i] r^(2i+2)) / (1 + Σ divided_by[i] r^(2i+2)); p1, p2 shift tangentially.
    """

    radial: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    denominator: tuple[float, ...] = ()

    @property
    def is_pinhole(self) -> bool:
        """Whether nothing is to be removed."""
        return not any((*self.radial, *self.tangential, *self.denominator))

    def distort(
        self, x: Float64[ndarray, "*n"], y: Float64[ndarray, "*n"]
    ) -> tuple[Float64[ndarray, "*n"], Float64[ndarray, "*n"]]:
        """Compute where the lens shows what a pinhole would show at x, y."""
        with np.errstate(over="ignore", invalid="ignore"):  # what is so far off is in no photo
            return self._distort(x, y)

    def distort_radius(self, radius: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
        """Compute the radius at which the lens shows a pinhole's, without shifts."""
        r2 = radius * radius
        with np.errstate(over="ignore", invalid="ignore"):
            return radius * (1 + _evaluate_series(self.radial, r2)) / (1 + _evaluate_series(self.denominator, r2))

    def scale_intrinsics(self, camera: Camera) -> tuple[float, float, float, float]:
        """Return fx, fy, cx, cy of the photo: the pinhole's own."""
        return camera.fx, camera.fy, camera.cx, camera.cy

    def _distort(self, x: Float64[ndarray, "*n"], y: Float64[ndarray, "*n"]) -> tuple[ndarray, ndarray]:
        r2 = x * x + y * y
        factor = (1 + _evaluate_series(self.radial, r2)) / (1 + _evaluate_series(self.denominator, r2))
        p1, p2 = self.tangential
        return (
            x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * factor + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
        )


AnyDistortion = Distortion | Fisheye


def undistort(image: UInt8[ndarray, "h w 3"], camera: Camera, distortion: AnyDistortion) -> UInt8[ndarray, "h w 3"]:
    """Make the photo that a pinhole with the camera's intrinsics would have taken, interpolated bilinearly."""
    rows, columns = _find_source_pixels(camera, distortion)
    channels = [
        ndimage.map_coordinates(image[:, :, channel].astype(np.float32), (rows, columns), order=1, mode="nearest")
        for channel in range(3)
    ]
    return np.clip(np.round(np.stack(channels, axis=2)), 0, 255).astype(np.uint8)


def find_covered_pixels(camera: Camera, distortion: AnyDistortion) -> Bool[ndarray, "h w"]:
    """Find the pixels of the undistorted photo that the photo on disk shows."""
    rows, columns = _find_source_pixels(camera, distortion)
    inside = (rows >= -0.5) & (rows <= camera.height - 0.5) & (columns >= -0.5) & (columns <= camera.width - 0.5)
    return inside & _is_before_fold(camera, distortion)


def _find_source_pixels(
    camera: Camera, distortion: AnyDistortion
) -> tuple[Float64[ndarray, "h w"], Float64[ndarray, "h w"]]:
    """Find row and column in the photo on disk (0 = centre of the first pixel) of each undistorted pixel."""
    x, y = distortion.distort(*_compute_pinhole_coordinates(camera))
    fx, fy, cx, cy = distortion.scale_intrinsics(camera)
    return y * fy + cy - 0.5, x * fx + cx - 0.5


def _compute_pinhole_coordinates(camera: Camera) -> tuple[Float64[ndarray, "h w"], Float64[ndarray, "h w"]]:
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    return (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy


def _is_before_fold(camera: Camera, distortion: AnyDistortion) -> Bool[ndarray, "h w"]:
    """Whether the distorted radius still rises with the radius: beyond, the polynomial folds back and means nothing."""
    x, y = _compute_pinhole_coordinates(camera)
    radius = np.hypot(x, y)
    steps = np.linspace(0, radius.max(), 512)
    falling = np.flatnonzero(np.diff(distortion.distort_radius(steps)) <= 0)
    return radius <= (steps[falling[0]] if len(falling) else np.inf)


def _evaluate_series(coefficients: tuple[float, ...], r2: Float64[ndarray, "*n"]) -> Float64[ndarray, "*n"]:
    total = np.zeros_like(r2)
    for coefficient in reversed(coefficients):
        total = (total + coefficient) * r2
    return total
