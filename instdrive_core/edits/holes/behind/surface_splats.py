"""Splats of a surface that one photo's pixels show, without gaps between them wherever it is looked at from."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.scene.camera import Camera

SPREAD = 0.6
"""Standard deviation of a splat in pixels."""
THINNEST = 0.2
"""Share of its width in the photo that a splat is thick at least."""
STEEPEST = 8.0
"""Pixel widths by which the depth changes at most from pixel to pixel: what is steeper is a step, no surface."""
LEAST_INVERSE = 1e-3
"""1/m: what is farther has no depth."""


def lay_splats(
    camera: Camera, pixels: Int64[ndarray, "k 2"], inverse: Float64[ndarray, "a b"], part: Bool[ndarray, "a b"]
) -> tuple[Float32[ndarray, "k 3"], Float32[ndarray, "k 4"], Float32[ndarray, "k 3"]]:
    """Lay a splat on the surface at each pixel.

    In the photo each is round. Along the surface it reaches from one pixel's place to the next one's, which far off
    and at a slant are metres apart.

    Args:
        camera: the photo's.
        pixels: row and column.
        inverse: inverse depths (1/m) in pixels that are larger by a whole factor.
        part: which of those belong to the surface, all around each of `pixels`.

    Returns:
        Means (metres, in the world), quaternions, logarithms of the standard deviations.
    """
    factor = camera.height // inverse.shape[0]
    weights = part.astype(np.float64)
    values = np.where(part, inverse, 0.0)

    def read(rows: float, columns: float) -> Float64[ndarray, " k"]:
        # Interpolated within the surface only, so that no steps of a large pixel show.
        places = (pixels.T + 0.5 + np.array([[rows], [columns]])) / factor - 0.5
        told = [ndimage.map_coordinates(each, places, order=1, mode="nearest") for each in (values, weights)]
        return told[0] / np.maximum(told[1], 1e-6)

    depths = 1 / np.maximum(read(0, 0), LEAST_INVERSE)
    rays = _aim_rays(camera, pixels)
    steps = []
    for axis, focal, (rows, columns) in ((0, camera.fx, (0, 0.5)), (1, camera.fy, (0.5, 0))):
        width = depths / focal
        change = -(depths**2) * (read(rows, columns) - read(-rows, -columns))
        step = rays * np.clip(change, -STEEPEST * width, STEEPEST * width)[:, None]
        step[:, axis] += width
        steps.append(step)
    along = np.stack(steps, axis=1) @ camera.world_from_camera[:3, :3].T
    quats, scales = _span_splats(along, SPREAD * depths / camera.fx)
    return place_pixels(camera, pixels, depths).astype(np.float32), quats, scales


def place_pixels(
    camera: Camera, pixels: Int64[ndarray, "k 2"], depths: Float64[ndarray, " k"]
) -> Float64[ndarray, "k 3"]:
    """Places in the world (metres) that pixels (row and column) show at depths along the viewing axis (metres)."""
    pose = camera.world_from_camera
    return (_aim_rays(camera, pixels) * depths[:, None]) @ pose[:3, :3].T + pose[:3, 3]


def _aim_rays(camera: Camera, pixels: Int64[ndarray, "k 2"]) -> Float64[ndarray, "k 3"]:
    """Rays through the pixels' centres in the camera's frame, a metre long along the viewing axis."""
    x = (pixels[:, 1] + 0.5 - camera.cx) / camera.fx
    y = (pixels[:, 0] + 0.5 - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(len(pixels))], axis=1)


def _span_splats(
    steps: Float64[ndarray, "k 2 3"], widths: Float64[ndarray, " k"]
) -> tuple[Float32[ndarray, "k 4"], Float32[ndarray, "k 3"]]:
    """Splats whose covariance is that of the two steps along a surface; `widths` in the photo bound how thin."""
    variances, axes = np.linalg.eigh(SPREAD**2 * np.einsum("ksi,ksj->kij", steps, steps))
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    scales = np.sqrt(np.maximum(variances, ((THINNEST * widths) ** 2)[:, None]))
    return quaternion_from_matrix(axes).astype(np.float32), np.log(scales).astype(np.float32)
