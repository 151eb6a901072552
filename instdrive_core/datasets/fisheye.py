"""Fisheye lenses, and the pinhole that keeps the asked part of their field.

Kannala and Brandt's angles as OpenCV (``cv::fisheye``), COLMAP and nerfstudio write them, with COLMAP's thin prism; and
Mei's mirror as KITTI-360 writes it (``cam2image`` of kitti360Scripts).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera

WIDEST = 160.0
"""Degrees: a pinhole's pixels beyond grow without bound."""


@dataclass(frozen=True)
class Fisheye:
    """A lens that shows what a pinhole would show at x, y (x/z, y/z) at a place found in three steps.

    First the angle θ from the axis is laid out as a radius, or the mirror's projection is taken. Then the radius r
    there becomes r (1 + Σ radial[i] r^(2i+2)). Last, p1, p2 and the prism's s1, s2 (times r²) shift it.
    """

    radial: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    prism: tuple[float, float] = (0.0, 0.0)
    mirror: float | None = None
    """Mei's ξ; None = angles."""
    intrinsics: tuple[float, float, float, float] | None = None
    """fx, fy, cx, cy of the photo on disk; None until the pinhole is chosen."""
    width: int = 0
    """Pixels of the photo on disk, which `intrinsics` are for."""

    @property
    def is_pinhole(self) -> bool:
        """Never: even without coefficients angles are bent."""
        return False

    def distort(
        self, x: Float64[ndarray, "*n"], y: Float64[ndarray, "*n"]
    ) -> tuple[Float64[ndarray, "*n"], Float64[ndarray, "*n"]]:
        """Compute where the lens shows what a pinhole would show at x, y."""
        with np.errstate(over="ignore", invalid="ignore"):  # what is so far off is in no photo
            bent = self._bend(np.hypot(x, y))
            u, v = x * bent, y * bent
            r2 = u * u + v * v
            factor = self._stretch(r2)
            (p1, p2), (s1, s2) = self.tangential, self.prism
            return (
                u * factor + 2 * p1 * u * v + p2 * (r2 + 2 * u * u) + s1 * r2,
                v * factor + 2 * p2 * u * v + p1 * (r2 + 2 * v * v) + s2 * r2,
            )

    def distort_radius(self, radius: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
        """Compute the radius at which the lens shows a pinhole's, without shifts."""
        bent = radius * self._bend(radius)
        return bent * self._stretch(bent * bent)

    def scale_intrinsics(self, camera: Camera) -> tuple[float, float, float, float]:
        """Compute fx, fy, cx, cy of the photo scaled as `camera` is, the chosen pinhole."""
        assert self.intrinsics is not None
        fx, fy, cx, cy = (value * camera.width / self.width for value in self.intrinsics)
        return fx, fy, cx, cy

    def _bend(self, radius: Float64[ndarray, "*n"]) -> Float64[ndarray, "*n"]:
        """The first step, relative to the radius."""
        if self.mirror is not None:
            return 1 / (1 + self.mirror * np.sqrt(1 + radius * radius))
        return np.where(radius > 1e-8, np.arctan(radius) / np.maximum(radius, 1e-8), 1.0)

    def _stretch(self, r2: Float64[ndarray, "*n"]) -> Float64[ndarray, "*n"]:
        total = np.zeros_like(r2)
        for coefficient in reversed(self.radial):
            total = (total + coefficient) * r2
        return 1 + total


def choose_pinhole(lens: Camera, fisheye: Fisheye, field: float) -> tuple[Camera, Fisheye]:
    """Choose the pinhole whose photos take a fisheye's place: of the same size, with its axis in the middle.

    Args:
        lens: the fisheye's intrinsics and pose, for the photo on disk.
        fisheye: its projection.
        field: degrees across the photo's width that are kept, or less where the lens shows less.
    """
    shown = min(math.radians(min(field, WIDEST)) / 2, _find_half_field(lens, fisheye))
    focal = lens.width / 2 / math.tan(shown)
    pinhole = replace(lens, fx=focal, fy=focal, cx=lens.width / 2, cy=lens.height / 2)
    return pinhole, replace(fisheye, intrinsics=(lens.fx, lens.fy, lens.cx, lens.cy), width=lens.width)


def _find_half_field(lens: Camera, fisheye: Fisheye) -> float:
    """Radians from the axis to the farther of the photo's left and right borders, or to where the lens folds back."""
    angles = np.radians(np.linspace(0.5, WIDEST / 2, 320))
    radii = fisheye.distort_radius(np.tan(angles))
    rising = np.flatnonzero(np.diff(radii, prepend=0.0) <= 0)
    inside = np.flatnonzero(radii * lens.fx > max(lens.cx, lens.width - lens.cx))
    last = min(rising[0] if len(rising) else len(angles), inside[0] if len(inside) else len(angles)) - 1
    return float(angles[max(last, 0)])
