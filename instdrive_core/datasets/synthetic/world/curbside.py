"""What stands along the kerbs: trees, lamp posts, signs, street furniture. Draws places by lot, keeps them apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from instdrive_core.datasets.synthetic.world import furniture
from instdrive_core.datasets.synthetic.world.ground import CROSS_HALF, CURB_HEIGHT, FRONT, ROAD_HALF, STREET_SPAN
from instdrive_core.datasets.synthetic.world.materials import MaterialPalette
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, join_meshes
from instdrive_core.datasets.synthetic.world.street import Fixture
from instdrive_core.datasets.synthetic.world.trees import SPECIES, build_bush, build_tree

Side = int
"""−1 left of the street, 1 right of it."""
_STATIC = "Other Static Object"


@dataclass
class CurbPlaces:
    """Stretches of the two kerbs that are taken."""

    taken: list[tuple[Side, float, float]] = field(default_factory=list)
    """Side, middle y, half length."""

    def claim(self, side: Side, y: float, half: float) -> bool:
        """Take the stretch y ± half if nobody has; whether it was free."""
        if any(s == side and abs(y - middle) < half + other for s, middle, other in self.taken):
            return False
        self.taken.append((side, y, half))
        return True


def face_street(side: Side) -> float:
    """Yaw that turns a model's −y face towards the street from `side`."""
    return np.pi / 2 * -side


def place_bus_stop(places: CurbPlaces, rng: np.random.Generator, palette: MaterialPalette) -> Fixture:
    """A shelter on the right, near where the clip starts."""
    y = float(rng.uniform(6, 14))
    places.claim(1, y, 2.2)
    shelter = furniture.build_bus_shelter(rng, palette)
    return Fixture(shelter.at(ROAD_HALF + 0.62, y, CURB_HEIGHT, face_street(1)), _STATIC)


def place_lamp_posts(
    crossing: float,
    places: CurbPlaces,
    rng: np.random.Generator,
    palette: MaterialPalette,
    street: tuple[float, float] = STREET_SPAN,
) -> list[Fixture]:
    """Every 22 m, in turn on either side."""
    fixtures = []
    start = street[0] + 4 + rng.uniform(0, 6)
    for side in (-1, 1):
        for y in np.arange(start + (11 if side > 0 else 0), street[1], 22.0):
            if abs(y - crossing) > CROSS_HALF + 2 and places.claim(side, float(y), 0.4):
                post = furniture.build_lamp_post(rng, palette)
                place = (side * (ROAD_HALF + 0.45), y, CURB_HEIGHT, face_street(side))
                fixtures.append(Fixture(post.at(*place), _STATIC))
    return fixtures


def place_crossing_signs(
    crossing: float, places: CurbPlaces, rng: np.random.Generator, palette: MaterialPalette
) -> list[Fixture]:
    """Traffic lights for both streets, green for the main one, and a crosswalk sign at each of its crosswalks."""
    fixtures = []
    for side in (-1, 1):
        yaw = _face_traffic(side)
        near = crossing - side * (CROSS_HALF + 0.6)
        light = furniture.build_traffic_light(palette, green=True)
        fixtures.append(Fixture(light.at(side * (ROAD_HALF + 0.5), near, CURB_HEIGHT, yaw), _STATIC))
        light = furniture.build_traffic_light(palette, green=False)
        beside = crossing + side * (CROSS_HALF + 0.5)
        place = (side * (ROAD_HALF + 3.0), beside, CURB_HEIGHT, yaw + np.pi / 2)
        fixtures.append(Fixture(light.at(*place), _STATIC))
        for stretch in (-1, 1):
            sign = furniture.build_traffic_sign(furniture.CROSSWALK_SIGN, rng, palette)
            y = crossing + stretch * (CROSS_HALF + 4.3)
            places.claim(side, y, 0.5)
            fixtures.append(Fixture(sign.at(side * (ROAD_HALF + 0.3), y, CURB_HEIGHT, yaw), "Signs"))
    return fixtures


def place_road_signs(
    crossing: float,
    places: CurbPlaces,
    rng: np.random.Generator,
    palette: MaterialPalette,
    street: tuple[float, float] = STREET_SPAN,
) -> list[Fixture]:
    """Signs of all kinds towards the traffic on their side."""
    fixtures = []
    for side in (-1, 1):
        faces = rng.permutation(furniture.ROAD_SIGNS)
        for k, y in enumerate(np.arange(-40.0, street[1] - 110, 17.0) + rng.uniform(-4, 4)):
            if abs(y - crossing) < CROSS_HALF + 8 or not places.claim(side, float(y), 0.6):
                continue
            sign = furniture.build_traffic_sign(int(faces[k % len(faces)]), rng, palette)
            turn = _face_traffic(side) + rng.uniform(-0.1, 0.1)
            fixtures.append(Fixture(sign.at(side * (ROAD_HALF + 0.32), float(y), CURB_HEIGHT, turn), "Signs"))
    return fixtures


def _face_traffic(side: Side) -> float:
    """Yaw of a model whose −y face is to be seen by drivers on `side`; they drive towards +y on the right."""
    return 0.0 if side > 0 else np.pi


def place_trees(
    crossing: float,
    places: CurbPlaces,
    rng: np.random.Generator,
    palette: MaterialPalette,
    street: tuple[float, float] = STREET_SPAN,
) -> list[Fixture]:
    """Rows of trees, mostly of one species per side."""
    fixtures = []
    for side in (-1, 1):
        usual = str(rng.choice(["plane", "maple", "cherry", "poplar"]))
        for y in np.arange(street[0] + 10, street[1] - 8, 13.5) + rng.uniform(-3, 3):
            y = float(y + rng.uniform(-1.6, 1.6))
            if abs(y - crossing) < CROSS_HALF + 8 or rng.random() < 0.12 or not places.claim(side, y, 0.7):
                continue
            species = SPECIES[usual if rng.random() < 0.75 else str(rng.choice(["plane", "maple", "cherry"]))]
            tree = build_tree(species, rng, palette)
            place = (side * (ROAD_HALF + 0.75), y, CURB_HEIGHT, rng.uniform(0, 6))
            fixtures.append(Fixture(tree.at(*place), "Vegetation"))
    return fixtures


def place_small_furniture(
    crossing: float,
    places: CurbPlaces,
    rng: np.random.Generator,
    palette: MaterialPalette,
    street: tuple[float, float] = STREET_SPAN,
) -> list[Fixture]:
    """Bins, hydrants, benches and the like, at the kerb or at the house fronts, out of the walkers' way."""
    builders: tuple[tuple[Callable[[], TriangleMesh], str, float, bool], ...] = (  # label, depth, also at houses
        (lambda: furniture.build_litter_bin(rng, palette), "Rolling Containers", 0.72, True),
        (lambda: furniture.build_hydrant(palette), _STATIC, 0.5, False),
        (lambda: furniture.build_bench(palette), _STATIC, 0.6, True),
        (lambda: furniture.build_post_box(palette), _STATIC, 0.5, True),
        (lambda: furniture.build_kiosk(rng, palette), _STATIC, 1.0, False),
        (lambda: _build_planted_tub(rng, palette), _STATIC, 0.9, False),
    )
    fixtures = []
    for side in (-1, 1):
        for y in np.arange(-52.0, street[1] - 98, 6.0) + rng.uniform(-1, 1):
            build, label, depth, anywhere = builders[rng.integers(len(builders))]
            at_houses = anywhere and rng.random() < 0.45
            if abs(y - crossing) < CROSS_HALF + 5 or rng.random() < 0.1:
                continue
            if not at_houses and not places.claim(side, float(y), 1.0):
                continue
            x = side * (FRONT - 0.06 - depth / 2 if at_houses else ROAD_HALF + 0.2 + depth / 2)
            fixtures.append(Fixture(build().at(x, float(y), CURB_HEIGHT, face_street(side)), label))
    return fixtures


def _build_planted_tub(rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A tub with a bush in it."""
    return join_meshes([furniture.build_planter(palette), build_bush(0.3, 0.8, 0.8, rng, palette).at(0, 0, 0.38)])
