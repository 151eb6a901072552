"""Who stands where in a jam: three full lanes that stop and go, two of them in the recording car's direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from instdrive_core.datasets.synthetic.world.cars import CAR_SHAPES
from instdrive_core.datasets.synthetic.world.ground import LANE, PARKING
from instdrive_core.datasets.synthetic.world.pace import StopAndGo
from instdrive_core.datasets.synthetic.world.street import Route

REACTION = 1.2
"""Seconds after which a vehicle repeats what the one ahead does."""
_AHEAD, _BEHIND = 75.0, 45.0  # metres of queue before and behind the recording car's place at time 0
_OWN_LENGTH = 5.0  # metres that the recording car takes
_GAPS = (1.3, 3.0)  # metres between bumpers while both stand
_MODELS, _CHANCES = ("hatchback", "sedan", "suv", "estate", "van"), (0.28, 0.24, 0.24, 0.12, 0.12)


@dataclass(frozen=True)
class QueuedVehicle:
    """A vehicle of a jam."""

    model: str
    """Key of `cars.CAR_SHAPES`."""
    route: Route


def draw_jammed_ego_route(rng: np.random.Generator) -> Route:
    """The recording car, in the left one of its direction's two lanes."""
    return Route(LANE, 0.0, pace=StopAndGo(float(rng.uniform(0, 6))))


def plan_jam(ego: Route, rng: np.random.Generator) -> list[QueuedVehicle]:
    """Place vehicles before and behind the recording car, in the lane to its right, and in the one that comes towards
    it. Raises ValueError where `ego` has no pace."""
    if ego.pace is None:
        raise ValueError("the recording car of a jam needs a pace")
    half = 0.5 * _OWN_LENGTH
    queues = [(ego.pace, ego.x, half, 1, _AHEAD, 0.0), (ego.pace, ego.x, -half, -1, _BEHIND, 0.0)]
    for x, yaw, rear in ((PARKING, 0.0, _BEHIND), (-LANE, np.pi, _AHEAD)):
        pace = StopAndGo(
            float(rng.uniform(0, 6)), float(rng.uniform(1.8, 3.2)), float(rng.uniform(5, 8)), float(rng.uniform(0.5, 2))
        )
        queues.append((pace, x, -rear + float(rng.uniform(-3, 3)), 1, _AHEAD + _BEHIND, yaw))
    planned = []
    for pace, x, bumper, order, length, yaw in queues:
        for model, along, own_pace in _line_up(pace, bumper, order, length, rng):
            y = along if yaw == 0 else -along
            aside, askew = float(rng.uniform(-0.1, 0.1)), rng.normal(0, 0.01)
            planned.append(QueuedVehicle(model, Route(x + aside, y, yaw + askew, pace=own_pace)))
    return planned


def _line_up(
    pace: StopAndGo, bumper: float, order: int, length: float, rng: np.random.Generator
) -> Iterator[tuple[str, float, StopAndGo]]:
    """Model, middle along the direction of travel and pace of each vehicle of a queue that begins at the bumper of
    one that moves at `pace`, and grows by `length` metres ahead of it (`order` 1) or behind it (−1)."""
    edge, end = bumper, bumper + order * length
    while order * (end - edge) > 0:
        model = str(rng.choice(_MODELS, p=_CHANCES))
        own = replace(pace, lead=pace.lead + order * REACTION)
        stretched = order * (own.measure_wave(0.0) - pace.measure_wave(0.0))
        near = edge + order * (float(rng.uniform(*_GAPS)) + stretched)
        edge = near + order * CAR_SHAPES[model].length
        yield model, 0.5 * (near + edge), own
        pace = own
