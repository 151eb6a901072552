"""The sky behind the Gaussians: (1 - alpha) · sky(direction) per pixel, and its gradients.

The lookup is that of `scene.sky.find_cube_tap`, a row of pixels at a time, so that it vectorises; a test holds the two
together.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.sky import Sky

_SHOWS = np.float32(1 / 1024)
"""Pixels that let less light through than this show no sky."""
_FAST = {"nsz", "arcp", "contract", "afn"}
_BAND = 16
"""Rows of pixels that add up their own gradient of the faces; the bands' sums are then added in order."""


def render_sky_behind(sky: Sky | None, camera: Camera, alpha: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w 3"]:
    """Render the sky's colour along each pixel's ray, times 1 - alpha; black without a sky."""
    behind = np.zeros((*alpha.shape, 3), np.float32)
    return behind if sky is None else copy_over_sky(sky, camera, behind, alpha)


def copy_over_sky(
    sky: Sky, camera: Camera, image: Float32[ndarray, "h w 3"], alpha: Float32[ndarray, "h w"]
) -> Float32[ndarray, "h w 3"]:
    """Copy an image with the sky put behind it."""
    result = np.empty(image.shape, np.float32)
    with numba.parallel_chunksize(_BAND):  # the sky fills some rows and misses others
        _over_sky(*_texels(sky), _ray_matrix(camera), to_kernel_array(alpha), to_kernel_array(image), result)
    return result


def add_sky(sky: Sky, camera: Camera, image: Float32[ndarray, "h w 3"], alpha: Float32[ndarray, "h w"]) -> None:
    """Put the sky behind an image, in place."""
    with numba.parallel_chunksize(_BAND):
        _over_sky(*_texels(sky), _ray_matrix(camera), alpha, image, image)


def render_sky_behind_backward(
    sky: Sky, camera: Camera, alpha: Float32[ndarray, "h w"], grad: Float32[ndarray, "h w 3"]
) -> tuple[Float32[ndarray, "h w"], Float32[ndarray, "6 r r 3"]]:
    """Gradients with respect to alpha and faces, given the gradient with respect to what `render_sky_behind` returned.

    The same input gives the same bits, whatever the number of threads.
    """
    texels, resolution = _texels(sky)
    bands = (len(alpha) + _BAND - 1) // _BAND
    sums, touched = np.empty((bands, *texels.shape), np.float32), np.zeros((bands, 6 * resolution), np.bool_)
    grad_alpha, grad_texels = np.empty(alpha.shape, np.float32), np.empty(texels.shape, np.float32)
    known = (to_kernel_array(grad), to_kernel_array(alpha), texels, resolution, _ray_matrix(camera))
    with numba.parallel_chunksize(1):
        _behind_backward(*known, grad_alpha, sums, touched)
    _add_bands(sums, touched, resolution, grad_texels)
    return grad_alpha, grad_texels.reshape(sky.faces.shape)


def _texels(sky: Sky) -> tuple[ndarray, int]:
    return to_kernel_array(sky.faces).reshape(-1, 3), sky.faces.shape[1]


def _ray_matrix(camera: Camera) -> Float32[ndarray, "3 3"]:
    """From (column, row, 1) of a pixel to the direction of the ray through its centre, of any length."""
    from_pixel = np.array(
        [
            [1 / camera.fx, 0, (0.5 - camera.cx) / camera.fx],
            [0, 1 / camera.fy, (0.5 - camera.cy) / camera.fy],
            [0, 0, 1],
        ]
    )
    return (camera.world_from_camera[:3, :3] @ from_pixel).astype(np.float32)


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _find_sky_columns(alpha):
    """Find the first column that shows sky, and one past the last."""
    first, last = 0, len(alpha)
    while first < last and np.float32(1) - alpha[first] < _SHOWS:
        first += 1
    while last > first and np.float32(1) - alpha[last - 1] < _SHOWS:
        last -= 1
    return first, last


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _find_taps(row, first, last, matrix, resolution, texels, shares):
    """Find the first of four texels that each pixel reads, and its shares of the right and lower neighbours."""
    zero, half = np.float32(0), np.float32(0.5)
    side, end, start = np.float32(resolution), np.float32(resolution - 1), np.int32(max(resolution - 2, 0))
    y = np.float32(row)
    x0, y0, z0 = (matrix[0, 1] * y + matrix[0, 2], matrix[1, 1] * y + matrix[1, 2], matrix[2, 1] * y + matrix[2, 2])
    for column in range(np.uint64(first), np.uint64(last)):
        step = np.float32(column)
        x, y, z = x0 + matrix[0, 0] * step, y0 + matrix[1, 0] * step, z0 + matrix[2, 0] * step
        ax, ay, az = abs(x), abs(y), abs(z)
        on_x, on_y = (ax >= ay) & (ax >= az), ay >= az
        axis = np.int32(0) if on_x else (np.int32(1) if on_y else np.int32(2))
        major = x if on_x else (y if on_y else z)
        across = y if on_x else (z if on_y else x)
        down = z if on_x else (x if on_y else y)
        scale = half / max(abs(major), np.float32(1e-12))
        u = min(max((across * scale + half) * side - half, zero), end)
        v = min(max((down * scale + half) * side - half, zero), end)
        left, top = min(np.int32(u), start), min(np.int32(v), start)
        face = np.int32(2) * axis + (np.int32(1) if major < zero else np.int32(0))
        texels[column] = (face * resolution + top) * resolution + left
        shares[0, column], shares[1, column] = u - np.float32(left), v - np.float32(top)


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _corner_weights(across, down):
    """Bilinear weights of a texel, its right, its lower and its lower right neighbour."""
    one = np.float32(1)
    return (one - down) * (one - across), (one - down) * across, down * (one - across), down * across


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _neighbours(resolution):
    """Steps from a texel to its right and its lower neighbour."""
    if resolution > 1:
        return np.uint64(1), np.uint64(resolution)
    return np.uint64(0), np.uint64(0)


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _add_sky_to_row(texels, resolution, matrix, row, alpha, image):
    first, last = _find_sky_columns(alpha)
    if first == last:
        return
    corners, shares = np.empty(len(alpha), np.int32), np.empty((2, len(alpha)), np.float32)
    _find_taps(row, first, last, matrix, np.int32(resolution), corners, shares)
    right, below = _neighbours(resolution)
    for column in range(np.uint64(first), np.uint64(last)):
        through = np.float32(1) - alpha[column]
        if through < _SHOWS:
            continue
        corner = np.uint64(corners[column])
        w0, w1, w2, w3 = _corner_weights(shares[0, column], shares[1, column])
        for c in range(np.uint64(3)):
            upper = w0 * texels[corner, c] + w1 * texels[corner + right, c]
            lower = w2 * texels[corner + below, c] + w3 * texels[corner + below + right, c]
            image[column, c] += through * (upper + lower)


@numba.njit(parallel=True, nogil=True, error_model="numpy", cache=True)
def _over_sky(texels, resolution, matrix, alpha, image, result):
    for row in numba.prange(len(alpha)):
        for column in range(alpha.shape[1]):  # assigning whole rows takes three seconds more to compile
            for c in range(3):
                result[row, column, c] = image[row, column, c]
        _add_sky_to_row(texels, resolution, matrix, row, alpha[row], result[row])


@numba.njit(error_model="numpy", cache=True)
def _open_texel_row(texel_row, resolution, sums, touched):
    """Clear a row of a band's sums when the first pixel needs it."""
    if not touched[texel_row]:
        touched[texel_row] = True
        sums[texel_row * resolution : (texel_row + 1) * resolution] = 0


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _row_backward(row, grad, alpha, texels, resolution, matrix, grad_alpha, sums, touched):
    grad_alpha[:] = 0
    first, last = _find_sky_columns(alpha)
    if first == last:
        return
    corners, shares = np.empty(len(alpha), np.int32), np.empty((2, len(alpha)), np.float32)
    _find_taps(row, first, last, matrix, np.int32(resolution), corners, shares)
    right, below = _neighbours(resolution)
    for column in range(np.uint64(first), np.uint64(last)):
        through = np.float32(1) - alpha[column]
        if through < _SHOWS:
            continue
        corner = np.uint64(corners[column])
        texel_row = corners[column] // resolution
        _open_texel_row(texel_row, resolution, sums, touched)
        if below:
            _open_texel_row(texel_row + 1, resolution, sums, touched)
        w0, w1, w2, w3 = _corner_weights(shares[0, column], shares[1, column])
        by_alpha = np.float32(0)
        for c in range(np.uint64(3)):
            upper = w0 * texels[corner, c] + w1 * texels[corner + right, c]
            lower = w2 * texels[corner + below, c] + w3 * texels[corner + below + right, c]
            by_alpha -= grad[column, c] * (upper + lower)
            shown = through * grad[column, c]
            sums[corner, c] += w0 * shown
            sums[corner + right, c] += w1 * shown
            sums[corner + below, c] += w2 * shown
            sums[corner + below + right, c] += w3 * shown
        grad_alpha[column] = by_alpha


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _behind_backward(grad, alpha, texels, resolution, matrix, grad_alpha, sums, touched):
    """Every band of rows writes to its own sums: pixels share texels, and the order of the sums must not change."""
    height = len(alpha)
    for band in numba.prange(len(sums)):
        for row in range(band * _BAND, min((band + 1) * _BAND, height)):
            into, own_touched = sums[band], touched[band]
            _row_backward(row, grad[row], alpha[row], texels, resolution, matrix, grad_alpha[row], into, own_touched)


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _add_bands(sums, touched, resolution, grad_texels):
    """Rows of texels that a band has not touched hold nothing in its sums, not even zeros."""
    for texel_row in numba.prange(touched.shape[1]):
        first, last = np.uint64(texel_row * resolution), np.uint64((texel_row + 1) * resolution)
        grad_texels[texel_row * resolution : (texel_row + 1) * resolution] = 0
        for band in range(len(touched)):
            if touched[band, texel_row]:
                for texel in range(first, last):
                    for c in range(np.uint64(3)):
                        grad_texels[texel, c] += sums[band, texel, c]
