"""Depths of posed photos: a small look at all of them tells who shows what, a closer one tells how far it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.progress import CancelledError, report, report_span
from instdrive_core.scene.camera import Camera
from instdrive_core.stereo.agreement import count_agreeing
from instdrive_core.stereo.partners import choose_partners, list_near_partners
from instdrive_core.stereo.plane_sweep import compute_costs
from instdrive_core.stereo.planes import Planes, choose_planes
from instdrive_core.stereo.semi_global import match_planes

_SMALL, _LARGE = 128, 320
"""Pixels along the longer side of the photos at the first and at the second look."""
_CLOSER = 1.25
"""Inverse depths are looked for up to so many times the largest that the first look found."""
_DEAREST = 150
"""Cost (of 255) above which a pixel's looks speak against its plane, or tell nothing, as in the sky."""
_LEAST_SIDE = 8
"""Pixels along the shorter side, below which a photo is not compared."""
_SAMPLES = 12
"""Points along a side of a photo by which partners are chosen."""

LoadGrey = Callable[[int, Camera], Float32[ndarray, "h w"]]
"""Loads a photo in grey values from 0 to 255, at the size of the camera."""


@dataclass(frozen=True)
class DepthMap:
    """How far off a photo's pixels are."""

    camera: Camera
    """At the size of the map."""
    depths: Float32[ndarray, "h w"]
    """Metres along the optical axis; 0 = unknown."""


def estimate_depths(cameras: Sequence[Camera], load_grey: LoadGrey) -> list[DepthMap]:
    """Estimate what depths photos agree on.

    Args:
        cameras: of the photos.
        load_grey: loads one of them; called by several threads.

    Reports progress; raises CancelledError where that is to stop.
    """
    small = [_shrink(camera, _SMALL) for camera in cameras]
    partners = _keep_large_enough(list_near_partners(small), small)
    planes = [
        choose_planes(small[number], [small[other] for other in others]) for number, others in enumerate(partners)
    ]
    with report_span(0.0, 0.15):
        first = _look(small, partners, planes, load_grey, 1)
    seen = [_sample_points(camera, inverse) for camera, inverse in zip(small, first, strict=True)]
    large = [_shrink(camera, _LARGE) for camera in cameras]
    partners = _keep_large_enough(choose_partners(large, seen), large)
    planes = []
    for number, others in enumerate(partners):
        known = first[number][first[number] > 0]
        nearest = float(np.quantile(known, 0.995)) * _CLOSER if len(known) else 0.0
        planes.append(choose_planes(large[number], [large[other] for other in others if len(known)], nearest))
    with report_span(0.15, 1.0):
        second = _look(large, partners, planes, load_grey, 2)
    with np.errstate(divide="ignore"):
        return [
            DepthMap(camera, np.where(inverse > 0, 1 / inverse, 0).astype(np.float32))
            for camera, inverse in zip(large, second, strict=True)
        ]


def _report_or_cancel(share: float, pool: ThreadPoolExecutor) -> None:
    """Report progress; where the work is to stop, what has not begun yet is dropped."""
    try:
        report(share)
    except CancelledError:
        pool.shutdown(wait=False, cancel_futures=True)
        raise


def _shrink(camera: Camera, longer: int) -> Camera:
    return camera.scale(min(1.0, longer / max(camera.width, camera.height)))


def _keep_large_enough(partners: list[Int64[ndarray, " k"]], cameras: list[Camera]) -> list[Int64[ndarray, " k"]]:
    """Leave out photos with too few pixels for a window, as partners and as photos."""
    fits = np.array([min(camera.width, camera.height) >= _LEAST_SIDE for camera in cameras])
    return [others[fits[others] & fits[number]] for number, others in enumerate(partners)]


def _look(
    cameras: list[Camera],
    partners: list[Int64[ndarray, " k"]],
    planes: list[Planes],
    load_grey: LoadGrey,
    confirmed_by: int,
) -> list[Float32[ndarray, "h w"]]:
    """Inverse depths that enough partners confirm, 0 elsewhere."""
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        photos = list(pool.map(load_grey, range(len(cameras)), cameras))

        def sweep(number: int) -> Float32[ndarray, "h w"]:
            others = partners[number]
            if not len(planes[number]):
                return np.zeros(photos[number].shape, np.float32)
            costs = compute_costs(
                photos[number],
                cameras[number],
                [(photos[other], cameras[other]) for other in others],
                planes[number].inverse,
            )
            chosen = match_planes(costs, photos[number])
            cost = np.take_along_axis(costs, np.rint(chosen).astype(np.int64)[..., None], axis=2)[..., 0]
            return np.where(cost <= _DEAREST, planes[number].look_up(chosen), np.float32(0))

        found = []
        for inverse in pool.map(sweep, range(len(cameras))):
            found.append(inverse)
            _report_or_cancel(len(found) / len(cameras), pool)

        def confirm(number: int) -> Float32[ndarray, "h w"]:
            others = [(found[other], cameras[other]) for other in partners[number]]
            counts = count_agreeing(found[number], cameras[number], others)
            return np.where(counts >= min(confirmed_by, max(len(others), 1)), found[number], 0).astype(np.float32)

        return list(pool.map(confirm, range(len(cameras))))


def _sample_points(camera: Camera, inverse: Float32[ndarray, "h w"]) -> Float64[ndarray, "p 3"]:
    """Points of a few known pixels, spread over the photo."""
    rows, columns = np.nonzero(inverse)
    if not len(rows):
        return np.zeros((0, 3))
    cells = rows * _SAMPLES // inverse.shape[0] * _SAMPLES + columns * _SAMPLES // inverse.shape[1]
    _, first = np.unique(cells, return_index=True)
    rows, columns = rows[first], columns[first]
    z = 1 / inverse[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - camera.cx) / camera.fx * z, (rows + 0.5 - camera.cy) / camera.fy * z, z], 1)
    return local @ camera.world_from_camera[:3, :3].T + camera.position
