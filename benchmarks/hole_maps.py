"""How well the ground under parked cars is guessed, seen from above, without training anything.

`python -m benchmarks.hole_maps --seeds 51 52` builds synthetic streets, finds by rays which ground no photo shows
because of a parked car, gives the fill the true colours of the rest (with the car's shadow, and a little noise), and
compares what it lays with the street ray-traced without the car. Trains nothing, so it is many times as fast as
`benchmarks.holes`, whose trained scenes are the judge in the end.

Prints one JSON line, medians over cars: PSNR (dB), the mean error of colours blurred over two cells, the share of
the squared error that lies on ground in the shade, and the share of the hole whose light (sun or shade) the fill knows.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import tyro
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from benchmarks.hole_light import MapLight, build_street_grid, choose_known, coarsen, find_map_light, list_cameras
from benchmarks.hole_streets import GROUND
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.sensors.render import StepRenderer
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose
from instdrive_core.datasets.synthetic.world.ground import CURB_HEIGHT
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.rig import CAMERAS
from instdrive_core.datasets.synthetic.world.street import Actor, Street
from instdrive_core.edits.holes.fill_plan import choose_ground_pieces
from instdrive_core.edits.holes.free_space import find_shown_points
from instdrive_core.edits.holes.ground_cells import grow_cells, keep_large_parts
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_light import GroundLight
from instdrive_core.edits.holes.ground_map import GroundMap
from instdrive_core.edits.holes.holes import (
    CELL,
    EDGE,
    HALF_LENGTH,
    HALF_WIDTH,
    MAX_AWAY,
    MIN_AREA,
    MIN_SIGHTINGS,
)
from instdrive_core.edits.holes.lanes.carriageway import measure_rise, profile_ground
from instdrive_core.edits.holes.seams import blend_copies
from instdrive_core.scene.camera import Camera

NEAREST = 13.0
"""Metres from the drive within which cars are looked at."""
EYE = 1.0
"""Metres above the ground from which the street is photographed, a few cells at a time."""
BLOCK = 5
"""Cells along and across of one such photo."""
NOISE, HEIGHT_NOISE = 0.015, 0.02
"""Standard deviations of known colours, and of heights in metres."""
BLUR = 2.0
"""Cells."""


@dataclass(frozen=True)
class Options:
    """Streets, and every how many time steps photos are asked what they show."""

    seeds: tuple[int, ...] = (51, 52, 53, 54, 55)
    every: int = 2
    light: bool = True
    """Whether the fill asks where the sun stands."""


@dataclass(frozen=True)
class HiddenGround:
    """The ground around one car."""

    ground: GroundMap
    known: Bool[ndarray, "a b"]
    hole: Bool[ndarray, "a b"]
    truth: Float32[ndarray, "a b 3"]
    lit: Bool[ndarray, "a b"]
    """In the sun."""
    parking: Bool[ndarray, " b"]
    """Lines along the lane on which the car stood."""
    light: GroundLight | None = None
    """What the fill knows of the light."""


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    results = []
    for seed in options.seeds:
        street = build_street(StreetConfig(seed=seed))
        light = _look_along(street, options.every) if options.light else None
        for number, found in list_hidden_ground(street, options.every, seed, light):
            results.append(measure_fill(found))
            print(f"{seed}-{number}", *(f"{value:.3f}" for value in results[-1]), file=sys.stderr, flush=True)
    psnr, blur, shade, told = (round(float(value), 3) for value in np.median(results, axis=0))
    means = [round(float(value), 3) for value in np.mean(results, axis=0)]
    return {
        "ground_psnr": psnr, "ground_blur": blur, "error_in_shade": shade, "light_told": told, "means": means,
        "cars": len(results),
    }  # fmt: skip


def measure_fill(found: HiddenGround) -> tuple[float, float, float, float]:
    """PSNR, blurred error, the share of the squared error in the shade, and that of the hole whose light is known."""
    profile, light = profile_ground(found.ground, found.known & ~found.hole, found.parking), found.light
    known = found.known if light is None else light.find_sources(found.known)
    sources = choose_ground_pieces(found.ground, known, found.hole, np.random.default_rng(0), profile, light)
    assert sources is not None
    offsets = sources - np.indices(found.hole.shape).transpose(1, 2, 0)
    shares = np.ones((1, 1, 3)) if light is None else light.compute_shares(found.hole)
    filled = blend_copies(found.ground.color / shares, known, found.hole, offsets, levels=profile) * shares
    filled = np.clip(filled, 0, 1)
    told = 0.0 if light is None else float(((light.shaded > 0.5) != found.lit)[found.hole].mean())
    difference = np.where(found.hole[..., None], filled - found.truth, 0)
    weight = ndimage.gaussian_filter(found.hole.astype(np.float64), BLUR)
    blurred = np.asarray(ndimage.gaussian_filter(difference, (BLUR, BLUR, 0))) / np.maximum(weight, 1e-6)[..., None]
    squares = (difference**2).mean(axis=2)[found.hole]
    shade = squares[~found.lit[found.hole]].sum() / max(squares.sum(), 1e-9)
    return float(-10 * np.log10(squares.mean())), float(np.abs(blurred[found.hole]).mean()), float(shade), told


def list_hidden_ground(
    street: Street, every: int, seed: int, light: MapLight | None = None
) -> Iterator[tuple[int, HiddenGround]]:
    """Parked cars beside the drive, by number of the actor, and the ground around each; the fill is told the `light`
    of the street."""
    times = [step * StreetConfig().step_seconds for step in range(0, StreetConfig().steps, every)]
    drive = np.array([compute_ego_pose(street, time)[:2, 3] for time in times])
    for number, actor in enumerate(street.actors):
        away = np.linalg.norm(drive - street.box_pose(actor, 0)[:2, 3], axis=1)
        if not actor.route.moves and actor.label == "Car" and away.min() < NEAREST:
            found = _look_under(street, number, actor, times, times[int(away.argmin())], seed)
            if found.hole.any() and found.known.any():
                yield number, found if light is None else _light(found, light, street.actor_id(number))


def _light(found: HiddenGround, street: MapLight, car: int) -> HiddenGround:
    """Lay on this ground the light that is told once the car is gone."""
    height = measure_rise(found.ground, found.known & ~found.hole, found.parking)
    light = street.light.light_ground(found.ground.grid, found.ground.color, found.hole, height, street.owners != car)
    return replace(found, light=light)


def _look_along(street: Street, every: int) -> MapLight | None:
    """The light on the street around the middle of the drive, from what its photos show."""
    times = [step * StreetConfig().step_seconds for step in range(0, StreetConfig().steps, every)]
    middle = times[len(times) // 2]
    grid = build_street_grid(float(compute_ego_pose(street, middle)[1, 3]))
    coarse = coarsen(grid)
    renderer = StepRenderer(street.geometry(middle), street.materials, street.light)
    color, ids = _photograph_from_above(renderer, coarse)
    names = np.array(["", *(fixture.label for fixture in street.fixtures)])
    classes = names[np.where(ids < len(names), ids, 0)]
    heights = np.where(classes == "Sidewalk", CURB_HEIGHT, 0.0)
    points = np.c_[coarse.compute_centers(coarse.list_cells()), heights.ravel() + 0.03]
    seen, _ = _count_photos(street, (renderer, renderer), points, times)
    known = choose_known(grid, color, classes, seen.reshape(coarse.shape))
    return find_map_light(street, list_cameras(street, times), known)


def _look_under(
    street: Street, number: int, actor: Actor, times: list[float], nearest: float, seed: int
) -> HiddenGround:
    rng, pose = np.random.default_rng([seed, number]), street.box_pose(actor, 0)
    shape = (round(2 * HALF_LENGTH / CELL), round(2 * HALF_WIDTH / CELL))
    grid = GroundGrid((0.0, 0.0), (0.0, 1.0), CELL, shape, (0.0, 0.0, 0.0))
    x, y = (pose[:2, 3] - np.array([HALF_LENGTH, HALF_WIDTH]) @ grid.axes).tolist()
    grid = replace(grid, corner=(x, y))
    without = replace(street, actors=tuple(each for k, each in enumerate(street.actors) if k != number))
    full, free = (StepRenderer(each.geometry(nearest), each.materials, each.light) for each in (street, without))
    truth, ids = _photograph_from_above(free, grid)
    classes = np.array(["", *(fixture.label for fixture in street.fixtures)])
    classes = classes[np.where(ids < len(classes), ids, 0)]
    level, height = np.isin(classes, GROUND), np.where(classes == "Sidewalk", CURB_HEIGHT, 0.0)
    points = np.c_[grid.compute_centers(grid.list_cells()), height.ravel() + 0.03]
    seen, hidden = _count_photos(street, (full, free), points, times)
    seen, hidden = seen.reshape(shape), hidden.reshape(shape)
    local, half = (
        (np.c_[points[:, :2], np.full(len(points), pose[2, 3])] - pose[:3, 3]) @ pose[:3, :3],
        actor.dimensions / 2,
    )
    under = (np.abs(local[:, :2]) <= half[:2]).all(axis=1).reshape(shape)
    edge = grow_cells(under, CELL, EDGE)
    behind = (seen < MIN_SIGHTINGS) & (hidden > 0) & grow_cells(under, CELL, MAX_AWAY)
    hole = keep_large_parts((behind | edge) & level, CELL, MIN_AREA)
    known = (seen >= MIN_SIGHTINGS) & level & ~hole & ~grow_cells(~level, CELL, EDGE)
    color = np.clip(_photograph_from_above(full, grid)[0] + NOISE * rng.standard_normal((*shape, 3)), 0, 1)
    height = height + HEIGHT_NOISE * rng.standard_normal(shape)
    ground = GroundMap(grid, known.astype(np.float64), color, height, ~level, np.zeros(0, bool))
    to_sun = np.broadcast_to(street.light.to_sun.astype(np.float32), points.shape).copy()
    lit = ~free.rays.find_occluded(points.astype(np.float32), to_sun, 150.0)
    return HiddenGround(ground, known, hole, truth, lit.reshape(shape), under.any(axis=0))


def _count_photos(
    street: Street, renderers: tuple[StepRenderer, StepRenderer], points: Float64[ndarray, "n 3"], times: list[float]
) -> tuple[Int64[ndarray, " n"], Int64[ndarray, " n"]]:
    """Photos that show each point, and photos that would show it without the car."""
    seen, hidden = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    size = StreetConfig()
    for time in times:
        for rig in CAMERAS:
            camera = rig.place(compute_ego_pose(street, time), size.width, size.height)
            rows = find_shown_points(points, camera)
            offsets = camera.position - points[rows]
            distances = np.linalg.norm(offsets, axis=1)
            rays = (offsets / distances[:, None]).astype(np.float32)
            starts = points[rows].astype(np.float32)
            with_car, without = (each.rays.find_first_hits(starts, rays).distances >= distances for each in renderers)
            seen[rows] += with_car
            hidden[rows] += without & ~with_car
    return seen, hidden


def _photograph_from_above(
    renderer: StepRenderer, grid: GroundGrid
) -> tuple[Float32[ndarray, "a b 3"], Int64[ndarray, "a b"]]:
    """Colours and instance IDs of the cells, from so low that neither trees nor balconies hide them."""
    color, ids = np.zeros((*grid.shape, 3), np.float32), np.zeros(grid.shape, np.int64)
    focal = EYE / grid.size
    for along in range(0, grid.shape[0], BLOCK):
        for across in range(0, grid.shape[1], BLOCK):
            rows, columns = min(BLOCK, grid.shape[0] - along), min(BLOCK, grid.shape[1] - across)
            pose = np.eye(4)
            pose[:2, 0], pose[:2, 1], pose[2, 2] = grid.axes[1], grid.axes[0], -1
            middle = np.array([along + rows / 2, across + columns / 2])
            pose[:3, 3] = *(np.array(grid.corner) + grid.size * middle @ grid.axes), EYE
            photo = renderer.photograph(Camera(focal, focal, columns / 2, rows / 2, columns, rows, pose))
            part = slice(along, along + rows), slice(across, across + columns)
            color[part], ids[part] = photo.image / 255, photo.labels
    return color, ids


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Options))))
