"""Photos whose rows are exposed one after the other, while the car drives on and the traffic moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from instdrive_core.datasets.synthetic.sensors.raytrace import LayeredRays, Rays, RayScene
from instdrive_core.datasets.synthetic.sensors.render import RenderedPhoto, StepRenderer
from instdrive_core.datasets.synthetic.world.street import Street, join_geometries
from instdrive_core.scene.camera import Camera

SLICE_SECONDS = 0.0025
"""Longest time for which the traffic is held still: 35 mm at 14 m/s. The camera moves with every row."""


@dataclass(frozen=True)
class Exposure:
    """One photo to be taken."""

    place: Callable[[float], Camera]
    """Camera in the street's frame at a time."""
    exposure: float


def compute_row_times(time: float, seconds: float, rows: int) -> list[float]:
    """Moments at which a photo's rows are exposed; the middle of the photo at `time`."""
    return [time + seconds * ((row + 0.5) / rows - 0.5) for row in range(rows)]


def photograph_rows(
    street: Street, standing: Rays, exposures: Sequence[Exposure], time: float, seconds: float, pool: Executor
) -> list[RenderedPhoto]:
    """Take photos of one size with a rolling shutter. Labels are those of each row's own moment.

    Args:
        standing: rays at `street.standing`.
        time: of the photos' middle.
        seconds: from the first to the last row.
    """
    camera = exposures[0].place(time)
    times = compute_row_times(time, seconds, camera.height)
    shape = (camera.height, camera.width)
    photos = [RenderedPhoto(np.empty((*shape, 3), np.uint8), np.empty(shape, np.uint16)) for _ in exposures]

    def expose(renderer: StepRenderer, rows: range, number: int) -> None:
        for row in rows:
            part = slice(row, row + 1)
            image, labels = photos[number].image[part].reshape(-1, 3), photos[number].labels[part].reshape(-1)
            taken = exposures[number]
            renderer.expose(taken.place(times[row]), part, taken.exposure, image, labels)

    for rows, renderer in _build_renderers(street, standing, time, times, seconds):
        for job in [pool.submit(expose, renderer, rows, number) for number in range(len(exposures))]:
            job.result()
    return photos


def _build_renderers(
    street: Street, standing: Rays, time: float, times: list[float], seconds: float
) -> Iterator[tuple[range, StepRenderer]]:
    """Build the street for each stretch of rows; limbs and wheels turn from photo to photo only."""
    models = street.model_movers(time)
    count = min(len(times), max(1, int(np.ceil(seconds / SLICE_SECONDS))))
    borders = np.linspace(0, len(times), count + 1).round().astype(int).tolist()
    for first, end in pairwise(borders):
        movers = join_geometries(street.pose_movers(models, 0.5 * (times[first] + times[end - 1])))
        rays = LayeredRays(standing, len(street.standing.mesh), RayScene(movers.mesh.corners))
        geometry = join_geometries([street.standing, movers])
        yield range(first, end), StepRenderer(geometry, street.materials, street.light, rays)
