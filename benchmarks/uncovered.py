"""What a deletion uncovers in a photo, against a photo that shows the same without the thing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene

BLUR = 8.0
"""Pixels: texture that is elsewhere than in truth is no error, another brightness is."""
LEAST = 50
"""Pixels of a part that are compared; fewer say nothing."""


@dataclass(frozen=True)
class Uncovered:
    """One photo without the thing, and the pixels that are compared."""

    view: CameraView
    truth: Float32[ndarray, "h w 3"]
    """Colours in [0, 1]."""
    parts: dict[str, Bool[ndarray, "h w"]]
    """``ground`` and ``wall`` are pixels that showed the thing and would show that; ``shadow`` is ground beside it that
    is brighter without it."""


@dataclass
class Errors:
    """Errors of one part over all photos of one car."""

    squared: list[float] = field(default_factory=list)
    blurred: list[float] = field(default_factory=list)
    pixels: list[int] = field(default_factory=list)

    @property
    def psnr(self) -> float:
        """Peak signal-to-noise ratio over all pixels, dB."""
        return float(-10 * np.log10(max(np.average(self.squared, weights=self.pixels), 1e-10)))

    @property
    def blur(self) -> float:
        """Mean error of the blurred colours."""
        return float(np.average(self.blurred, weights=self.pixels))


def measure_errors(scene: Scene, photos: Iterable[Uncovered]) -> dict[str, Errors]:
    """Compare a scene with what photos without the thing show, by part; parts that no photo shows are left out."""
    found: dict[str, Errors] = {}
    for photo in photos:
        difference = draw_photo(scene, photo.view) - photo.truth
        for name, inside in photo.parts.items():
            if inside.sum() >= LEAST:
                errors = found.setdefault(name, Errors())
                errors.squared.append(float((difference[inside] ** 2).mean()))
                errors.blurred.append(float(np.abs(blur_inside(difference, inside)[inside]).mean()))
                errors.pixels.append(int(inside.sum()))
    return found


def draw_photo(scene: Scene, view: CameraView) -> Float32[ndarray, "h w 3"]:
    """Draw a scene as a photo of it came out."""
    image = view_scene(scene, view.camera, view.time).color
    if scene.exposures is not None:
        image = apply_exposure(image, scene.exposures.interpolate(view.name, view.time))
    return np.clip(image, 0, 1)


def summarize_errors(cars: Sequence[dict[str, Errors]]) -> dict[str, float | None]:
    """Medians over cars, by the names of the JSON line; None where no car has the part."""
    figures: dict[str, float | None] = {}
    for key, part in (("ground_psnr", "ground"), ("wall_psnr", "wall"), ("shadow_psnr", "shadow")):
        figures[key] = take_median([car[part].psnr for car in cars if part in car], 2)
    figures["ground_blur"] = take_median([car["ground"].blur for car in cars if "ground" in car], 3)
    return figures


def take_median(values: list[float], digits: int) -> float | None:
    """The rounded median; None of nothing."""
    return round(float(np.median(values)), digits) if values else None


def blur_inside(difference: Float32[ndarray, "h w 3"], inside: Bool[ndarray, "h w"]) -> Float32[ndarray, "h w 3"]:
    weight = gaussian_filter(inside.astype(np.float32), BLUR)
    parts = [gaussian_filter(difference[..., c] * inside, BLUR) / np.maximum(weight, 1e-6) for c in range(3)]
    return np.stack(parts, axis=-1)
