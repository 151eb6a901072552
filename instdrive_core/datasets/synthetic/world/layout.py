"""Draws a street by lot: which houses, trees, poles, cars and people stand or move where."""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np

from instdrive_core.datasets.synthetic.config import JAM, USUAL_RATE, StreetConfig
from instdrive_core.datasets.synthetic.world import curbside
from instdrive_core.datasets.synthetic.world.buildings import build_building
from instdrive_core.datasets.synthetic.world.curbside import CurbPlaces, Side, face_street
from instdrive_core.datasets.synthetic.world.ground import (
    CROSS_HALF,
    CROSS_SPAN,
    CURB_HEIGHT,
    FRONT,
    PAVEMENT_WIDTH,
    STREET_SPAN,
    build_ground,
    compute_street_height,
)
from instdrive_core.datasets.synthetic.world.jam import draw_jammed_ego_route
from instdrive_core.datasets.synthetic.world.light import Light
from instdrive_core.datasets.synthetic.world.materials import MaterialPalette
from instdrive_core.datasets.synthetic.world.street import Fixture, Street
from instdrive_core.datasets.synthetic.world.traffic import (
    build_jammed_traffic,
    build_road_works,
    build_traffic,
    build_walkers,
    draw_ego_route,
    park_cars,
)
from instdrive_core.datasets.synthetic.world.trees import SPECIES, build_bush, build_tree

_HALF_TURN = np.pi
FASTEST = 8.4
"""Metres per second that no vehicle exceeds."""
USUAL_STEPS = 100
"""Time steps for which the street has its usual length."""


@lru_cache(maxsize=2)
def build_street(config: StreetConfig) -> Street:
    """The street of a seed. Independent parts draw from independent generators, so that one can change without the
    others. The last two are kept: who writes a clip often asks for its masks next."""
    names = ("ground", "houses", "trees", "furniture", "parked", "traffic", "people", "light")
    generators = dict(zip(names, np.random.SeedSequence(config.seed).spawn(len(names)), strict=True))
    rng = {name: np.random.default_rng(sequence) for name, sequence in generators.items()}
    palette, places = MaterialPalette(), CurbPlaces()
    crossing = float(np.round(rng["ground"].uniform(31, 38), 2))
    steps = config.steps * USUAL_RATE / config.rate
    span, spread = compute_street_span(steps), min(1.0, USUAL_STEPS / steps)
    ground = build_ground(crossing, rng["ground"], palette, span)
    fixtures = [
        Fixture(ground.road, "Road", "stuff"),
        Fixture(ground.left_pavement, "Sidewalk", "stuff"),
        Fixture(ground.right_pavement, "Sidewalk", "stuff"),
        Fixture(ground.lots, "Ground", "stuff"),
        *_build_houses(crossing, rng["houses"], rng["trees"], palette, span),
        curbside.place_bus_stop(places, rng["furniture"], palette),
        *curbside.place_crossing_signs(crossing, places, rng["furniture"], palette),
        *curbside.place_lamp_posts(crossing, places, rng["furniture"], palette, span),
        *curbside.place_road_signs(crossing, places, rng["furniture"], palette, span),
        *curbside.place_trees(crossing, places, rng["trees"], palette, span),
        *curbside.place_small_furniture(crossing, places, rng["furniture"], palette, span),
    ]
    height = partial(compute_street_height, crossing=crossing)
    works_place = float(rng["parked"].uniform(9, 19))
    is_jammed = config.traffic == JAM
    parked = park_cars(crossing, works_place, rng["parked"], palette, span, (-1,) if is_jammed else (-1, 1))
    if is_jammed:
        ego = draw_jammed_ego_route(rng["traffic"])
        traffic = build_jammed_traffic(ego, crossing, rng["traffic"], palette)
    else:
        traffic = build_traffic(crossing, rng["traffic"], palette, span, spread)
        ego = draw_ego_route(rng["traffic"])
    actors = [
        *parked,
        *traffic,
        *build_walkers(crossing, places, rng["people"], palette, span, spread),
        *build_road_works(works_place, rng["parked"], palette),
    ]
    return Street(
        tuple(fixtures), tuple(actors), ego, crossing, palette.table(),
        _draw_light(rng["light"]), float(rng["light"].uniform(-np.pi, np.pi)), height,
    )  # fmt: skip


def compute_street_span(steps: float) -> tuple[float, float]:
    """Ends of the street along y, for a drive of so many steps at the usual rate: as far again as the fastest traffic
    comes in the time beyond ten seconds."""
    extra = FASTEST * max(0, steps - USUAL_STEPS) * (1 / USUAL_RATE)
    return STREET_SPAN[0] - extra, STREET_SPAN[1] + extra


def _draw_light(rng: np.random.Generator) -> Light:
    elevation = np.radians(rng.uniform(38, 55))
    azimuth = np.radians(rng.choice([-1, 1]) * rng.uniform(25, 75) + rng.choice([0, 180]))
    to_sun = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    return Light(to_sun, float(rng.uniform(0, 50)))


def _build_houses(
    crossing: float, rng: np.random.Generator, tree_rng: np.random.Generator, palette: MaterialPalette,
    span: tuple[float, float],
) -> list[Fixture]:  # fmt: skip
    """Rows of houses along both streets, gardens between them, houses that close the view, and distant towers."""
    fixtures: list[Fixture] = []
    gap = CROSS_HALF + PAVEMENT_WIDTH
    for side in (-1, 1):
        for start, direction in ((crossing - gap, -1), (crossing + gap, 1)):
            end = span[0] if direction < 0 else span[1]
            fixtures += _build_row(side, start, end, direction, rng, tree_rng, palette)
            fixtures += _build_cross_row(side, start, direction, rng, palette)
    for y, yaw in ((span[0] - 0.5, _HALF_TURN), (span[1] + 0.5, 0.0)):
        for x in (-32.0, -15.5, 1.0, 17.5):
            width = 15.5
            place = (x, y) if yaw == 0 else (x + width, y)
            mesh = build_building(width, 10, int(rng.integers(3, 6)), "home", rng, palette)
            fixtures.append(Fixture(mesh.at(*place, 0, yaw), "Building"))
    for k in range(round(6 * (span[1] - span[0]) / (STREET_SPAN[1] - STREET_SPAN[0]))):
        side, width = (-1, 1)[k % 2], float(rng.uniform(16, 24))
        mesh = build_building(width, width, int(rng.integers(9, 16)), "home", rng, palette)
        y = span[0] + 20 + 55 * k + rng.uniform(-8, 8)
        fixtures.append(Fixture(mesh.at(side * rng.uniform(62, 80), y, 0, face_street(side)), "Building"))
    return fixtures


def _build_row(
    side: Side, start: float, end: float, direction: int,
    rng: np.random.Generator, tree_rng: np.random.Generator, palette: MaterialPalette,
) -> list[Fixture]:  # fmt: skip
    """Houses along the main street from `start` at the crossing to `end`."""
    fixtures: list[Fixture] = []
    y, count = start, 0
    while abs(end - y) > 9:
        garden = count > 0 and rng.random() < 0.18
        width = float(rng.uniform(8.5, 14.5))
        low = min(y, y + direction * width)
        if garden:
            fixtures += _build_garden(side, low, width, tree_rng, palette)
        else:
            use = str(rng.choice(["shop", "home", "home", "garage"])) if count else "shop"
            floors = 1 + int(rng.integers(0, 2)) if use == "garage" else int(rng.integers(2, 6))
            mesh = build_building(width, 11.0, floors, use, rng, palette)
            corner = low + width if side > 0 else low  # where x = 0 of the model comes to lie
            house = mesh.at(side * FRONT, corner, CURB_HEIGHT - 0.01, face_street(side))
            fixtures.append(Fixture(house, "Building"))
        y += direction * (width + (0.0 if rng.random() < 0.75 else 1.2))
        count += 1
    return fixtures


def _build_cross_row(
    side: Side, start: float, direction: int, rng: np.random.Generator, palette: MaterialPalette
) -> list[Fixture]:
    """Houses along the crossing street, behind the corner house."""
    fixtures = []
    x = FRONT + 11.6
    while x < CROSS_SPAN[1] - 12:
        width = float(rng.uniform(9, 13))
        mesh = build_building(width, 10.0, int(rng.integers(2, 5)), "home", rng, palette)
        yaw = 0.0 if direction > 0 else _HALF_TURN
        low = x if side > 0 else -x - width
        corner = low if direction > 0 else low + width
        fixtures.append(Fixture(mesh.at(corner, start, CURB_HEIGHT - 0.01, yaw), "Building"))
        x += width + 0.3
    return fixtures


def _build_garden(
    side: Side, low: float, width: float, rng: np.random.Generator, palette: MaterialPalette
) -> list[Fixture]:
    """A hedge along the pavement with trees and bushes behind it."""
    ground = CURB_HEIGHT - 0.02
    hedge = build_bush(width - 0.6, 0.8, 1.1, rng, palette)
    fixtures = [Fixture(hedge.at(side * (FRONT + 0.6), low + width / 2, ground, _HALF_TURN / 2), "Vegetation")]
    for share in (0.25, 0.75):
        species = SPECIES[str(rng.choice(["spruce", "cherry", "plane", "poplar"]))]
        x = side * (FRONT + rng.uniform(3.5, 7.5))
        tree = build_tree(species, rng, palette).at(x, low + share * width, ground, rng.uniform(0, 6))
        fixtures.append(Fixture(tree, "Vegetation"))
    bush = build_bush(0.5, 1.4, 1.3, rng, palette)
    fixtures.append(Fixture(bush.at(side * (FRONT + 2.6), low + 0.5 * width, ground), "Vegetation"))
    return fixtures
