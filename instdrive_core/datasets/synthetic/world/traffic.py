"""Vehicles and people of the street, as actors with routes."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from functools import partial

import numpy as np

from instdrive_core.datasets.synthetic.world import furniture
from instdrive_core.datasets.synthetic.world.cars import CAR_COLORS, CAR_SHAPES, build_car
from instdrive_core.datasets.synthetic.world.curbside import CurbPlaces
from instdrive_core.datasets.synthetic.world.ground import CROSS_HALF, FRONT, LANE, PARKING, ROAD_HALF, STREET_SPAN
from instdrive_core.datasets.synthetic.world.jam import plan_jam
from instdrive_core.datasets.synthetic.world.materials import MaterialPalette
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh
from instdrive_core.datasets.synthetic.world.people import draw_cyclist, draw_person
from instdrive_core.datasets.synthetic.world.street import Actor, Route

EGO_SPEED = 7.0
_HALF_TURN = np.pi
_COMMON = ["hatchback", "sedan", "suv", "estate", "van"]


def draw_ego_route(rng: np.random.Generator) -> Route:
    """The recording car: up the right lane, making a little room to the left."""
    return Route(LANE, 0.0, 0.0, EGO_SPEED, -float(rng.uniform(0.3, 0.6)), 28.0)


def _draw_uuid(rng: np.random.Generator) -> uuid.UUID:
    return uuid.UUID(bytes=rng.bytes(16), version=4)


def _keep_mesh(mesh: TriangleMesh, distance: float) -> TriangleMesh:
    return mesh


def _build_vehicle(
    model: str, route: Route, motion: str, color: int, rng: np.random.Generator, palette: MaterialPalette
) -> Actor:
    shape = CAR_SHAPES[model]
    mesh = build_car(shape, CAR_COLORS[color], rng, palette)
    low, high = (bound.astype(float) for bound in mesh.bounds())
    return Actor(shape.label, route, partial(_keep_mesh, mesh), low, high, _draw_uuid(rng), motion=motion)


def _draw_colors(rng: np.random.Generator, count: int) -> list[int]:
    """Colours such that neighbours differ."""
    drawn: list[int] = []
    while len(drawn) < count:
        drawn += [int(k) for k in rng.permutation(len(CAR_COLORS))]
    return drawn[:count]


def park_cars(
    crossing: float, works: float, rng: np.random.Generator, palette: MaterialPalette,
    street: tuple[float, float] = STREET_SPAN, sides: tuple[int, ...] = (-1, 1),
) -> list[Actor]:  # fmt: skip
    """Cars along the kerbs of `sides`, with empty places; none at the road works on the left at y = `works`."""
    models = ("hatchback", "sedan", "suv", "estate", "van", "pickup")
    chances = (0.27, 0.22, 0.22, 0.13, 0.09, 0.07)
    actors = []
    for side in sides:
        colors = iter(_draw_colors(rng, max(60, round(street[1] - 130))))
        y = -62.0 + rng.uniform(0, 4)
        while y < street[1] - 72:
            model = str(rng.choice(models, p=chances))
            length = CAR_SHAPES[model].length
            middle = y + length / 2
            at_works = side < 0 and abs(middle - works) < 3.4 + length / 2
            if abs(middle - crossing) > CROSS_HALF + 10 and rng.random() > 0.24 and not at_works:
                yaw = (0.0 if side > 0 else _HALF_TURN) + rng.normal(0, 0.015)
                route = Route(side * PARKING + rng.uniform(-0.1, 0.1), middle, yaw)
                actors.append(_build_vehicle(model, route, "Parked", next(colors), rng, palette))
            y += length + rng.uniform(0.8, 1.9)
    return actors


def build_traffic(
    crossing: float, rng: np.random.Generator, palette: MaterialPalette, street: tuple[float, float] = STREET_SPAN,
    spread: float = 1.0,
) -> list[Actor]:  # fmt: skip
    """Cars ahead of, behind and towards the recording one; others wait at the crossing's red light; cyclists.

    `spread` narrows the differences of speed, so that nobody runs into anybody in a long drive.
    """
    colors = iter(_draw_colors(rng, 40))

    def vehicle(model: str, route: Route, motion: str = "Moving") -> Actor:
        return _build_vehicle(model, route, motion, next(colors), rng, palette)

    def any_model() -> str:
        return str(rng.choice(_COMMON))

    actors = []
    for y in (17.0, 38.0, 66.0):
        actors.append(
            vehicle(any_model(), Route(LANE, y + rng.uniform(-2, 3), 0.0, EGO_SPEED + spread * rng.uniform(0, 1.2)))
        )
    for y in (-14.0, -33.0):
        actors.append(
            vehicle(any_model(), Route(LANE, y + rng.uniform(-3, 1), 0.0, EGO_SPEED - spread * rng.uniform(0, 0.8)))
        )
    oncoming = ("truck", any_model(), any_model(), "van", any_model())
    for model, y in zip(rng.permutation(oncoming), (-24.0, 15.0, 31.0, 54.0, 78.0), strict=True):
        route = Route(-LANE + 0.12, y + rng.uniform(-3, 3), _HALF_TURN, float(rng.uniform(6.9, 6.9 + 0.3 * spread)))
        actors.append(vehicle(str(model), route))
    for y in np.arange(104.0, street[1] - 90, 26.0):  # later ones of long drives
        route = Route(-LANE + 0.12, y + rng.uniform(-3, 3), _HALF_TURN, float(rng.uniform(6.9, 6.9 + 0.3 * spread)))
        actors.append(vehicle(any_model(), route))
    actors += _stop_at_crossing(crossing, rng, lambda route: vehicle(any_model(), route, "Stopped"))
    for x, y, yaw in ((3.03, rng.uniform(21, 25), 0.0), (-3.1, rng.uniform(14, 24), _HALF_TURN)):
        actors.append(_build_cyclist(Route(x, y, yaw, float(rng.uniform(4.2, 5.2))), rng, palette))
    return actors


def build_jammed_traffic(
    ego: Route, crossing: float, rng: np.random.Generator, palette: MaterialPalette
) -> list[Actor]:
    """The queues of a jam around the recording car, and cars at the crossing's red light."""
    planned = plan_jam(ego, rng)
    colors = iter(_draw_colors(rng, len(planned) + 4))

    def vehicle(model: str, route: Route, motion: str) -> Actor:
        return _build_vehicle(model, route, motion, next(colors), rng, palette)

    actors = [vehicle(queued.model, queued.route, "Moving") for queued in planned]
    actors += _stop_at_crossing(crossing, rng, lambda route: vehicle(str(rng.choice(_COMMON)), route, "Stopped"))
    return actors


def _stop_at_crossing(crossing: float, rng: np.random.Generator, build: Callable[[Route], Actor]) -> list[Actor]:
    """Two cars that wait on either side of the crossing street."""
    actors = []
    for side in (-1, 1):
        place = (side * (ROAD_HALF + 7.4), crossing + side * 2.1, side * _HALF_TURN / 2)
        actors.append(build(Route(*place)))
        behind = (place[0] + side * rng.uniform(6.3, 7.5), place[1], place[2])
        actors.append(build(Route(*behind)))
    return actors


def _build_cyclist(route: Route, rng: np.random.Generator, palette: MaterialPalette) -> Actor:
    cyclist = draw_cyclist(rng, palette)
    low, high = (bound.astype(float) for bound in cyclist.cuboid())
    return Actor("Bicycle", route, cyclist.mesh, low, high, _draw_uuid(rng), motion="Moving", rider="With Rider")


def build_walkers(
    crossing: float, places: CurbPlaces, rng: np.random.Generator, palette: MaterialPalette,
    street: tuple[float, float] = STREET_SPAN, spread: float = 1.0,
) -> list[Actor]:  # fmt: skip
    """People on both pavements in either direction, on the crossing street's crosswalks, and some who stand."""
    actors = []
    for side in (-1, 1):
        for y in [*np.linspace(-22, 58, 8), *np.arange(70.0, street[1] - 120, 12.0)]:
            inner = rng.random() < 0.5
            x = side * (FRONT - (1.73 if inner else 1.2) + rng.uniform(-0.04, 0.04))
            yaw = 0.0 if inner else _HALF_TURN
            route = Route(float(x), float(y + rng.uniform(-3.5, 3.5)), yaw, float(rng.uniform(1.1, 1.1 + 0.5 * spread)))
            actors.append(_build_person(route, rng, palette))
        x = side * (ROAD_HALF + rng.uniform(0.75, 0.85))
        y = crossing - side * rng.uniform(2.0, 3.5)
        route = Route(float(x), float(y), 0.0 if side > 0 else _HALF_TURN, float(rng.uniform(1.1, 1.4)))
        actors.append(_build_person(route, rng, palette))
        spot = next(y for y in rng.uniform(-12, 24, 200) if places.claim(side, float(y), 0.5))
        standing = Route(side * (ROAD_HALF + 0.7), float(spot), float(rng.uniform(-3, 3)))
        actors.append(_build_person(standing, rng, palette))
    return actors


def _build_person(route: Route, rng: np.random.Generator, palette: MaterialPalette) -> Actor:
    person = draw_person(rng, palette)
    walking = route.moves
    low, high = (bound.astype(float) for bound in person.cuboid(walking))
    label = "Pedestrian with Object" if person.carries in ("backpack", "bag") else "Pedestrian"
    return Actor(
        label, route, partial(person.mesh, walking=walking), low, high, _draw_uuid(rng),
        behavior="Walking" if walking else "Standing",
    )  # fmt: skip


def build_road_works(y: float, rng: np.random.Generator, palette: MaterialPalette) -> list[Actor]:
    """Cones around barriers in the left parking strip."""
    cone = furniture.build_cone(palette)
    actors = []
    for dx, dy in ((0.95, -2.3), (0.95, 0.0), (0.95, 2.3), (-0.7, -2.5)):
        route = Route(-PARKING + dx, y + dy, float(rng.uniform(-3, 3)))
        low, high = (bound.astype(float) for bound in cone.bounds())
        actors.append(Actor("Cones", route, partial(_keep_mesh, cone), low, high, _draw_uuid(rng)))
    for dy in (-1.6, 1.6):
        mesh = furniture.build_barrier(palette)
        low, high = (bound.astype(float) for bound in mesh.bounds())
        route = Route(-PARKING, y + dy, float(rng.uniform(-0.06, 0.06)))
        label = "Temporary Construction Barriers"
        actors.append(Actor(label, route, partial(_keep_mesh, mesh), low, high, _draw_uuid(rng)))
    return actors
