"""Distance of a rendered image from its photo, outside masked regions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy import ndimage

SSIM_SIGMA = 1.5
SSIM_RADIUS = 5
"""Half of the 11×11 window, without its centre."""
_MSE_FLOOR = 1e-10


def psnr(
    image: Float[ndarray, "h w c"], truth: Float[ndarray, "h w c"], valid: Bool[ndarray, "h w"] | None = None
) -> float | None:
    """Peak signal-to-noise ratio in dB over the valid pixels, for images in [0, 1].

    Capped at 100 dB, so that equal images have a finite value. None where no pixel is valid.
    """
    squared = np.square(image.astype(np.float64) - truth)
    inside = squared if valid is None else squared[valid]
    if not inside.size:
        return None
    return float(-10 * np.log10(max(inside.mean(), _MSE_FLOOR)))


def ssim(
    image: Float[ndarray, "h w c"], truth: Float[ndarray, "h w c"], valid: Bool[ndarray, "h w"] | None = None
) -> float | None:
    """Structural similarity (Wang et al. 2004) of images in [0, 1], with an 11×11 Gaussian window of σ = 1.5.

    The mean over channels and over the pixels whose whole window is valid and inside the image, so that masked
    pixels have no influence at all. None where no window is.
    """
    whole = _find_whole_windows(image.shape[:2], valid)
    if not whole.any():
        return None
    return float(_compute_ssim_map(image.astype(np.float64), truth.astype(np.float64))[whole].mean())


def _compute_ssim_map(first: Float[ndarray, "h w c"], second: Float[ndarray, "h w c"]) -> Float[ndarray, "h w c"]:
    c1, c2 = 0.01**2, 0.03**2
    mean1, mean2 = _blur(first), _blur(second)
    variance1 = _blur(first * first) - mean1 * mean1
    variance2 = _blur(second * second) - mean2 * mean2
    covariance = _blur(first * second) - mean1 * mean2
    luminance = (2 * mean1 * mean2 + c1) / (mean1 * mean1 + mean2 * mean2 + c1)
    return luminance * (2 * covariance + c2) / (variance1 + variance2 + c2)


def _blur(values: Float[ndarray, "h w c"]) -> Float[ndarray, "h w c"]:
    return ndimage.gaussian_filter(values, SSIM_SIGMA, axes=(0, 1), radius=SSIM_RADIUS)


def _find_whole_windows(shape: tuple[int, int], valid: Bool[ndarray, "h w"] | None) -> Bool[ndarray, "h w"]:
    """Pixels whose SSIM window holds valid pixels of the image only."""
    inside = np.ones(shape, bool) if valid is None else valid
    size = 2 * SSIM_RADIUS + 1
    return ndimage.minimum_filter(inside.astype(np.uint8), size=size, mode="constant", cval=0).astype(bool)
