"""A small street with cars, drawn at random: enough of everything for every edit to find something to do."""

from __future__ import annotations

import numpy as np

from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

CAR = np.array([1.9, 4.5, 1.6])
"""Width, length and height in metres."""


def build_edit_street(seed: int = 0, ground: int = 1500, cars: int = 6, actors: int = 2, per_car: int = 120) -> Scene:
    """Ground, parked cars (instances 1 …) and driving ones (the last instances), with codewords and SH of degree 1."""
    rng = np.random.default_rng(seed)
    plane = np.c_[rng.uniform(-8, 8, ground), rng.uniform(-20, 20, ground), rng.normal(0, 0.01, ground)]
    bodies = rng.uniform(-0.5, 0.5, (cars + actors, per_car, 3)) * CAR
    places = np.c_[rng.choice([-5.0, 5.0], cars), np.linspace(-16, 16, cars), np.full(cars, CAR[2] / 2)]
    bodies[:cars] += places[:, None]
    means = np.concatenate([plane, bodies.reshape(-1, 3)]).astype(np.float32)
    count = len(means)
    ids = np.concatenate([np.zeros(ground), np.repeat(np.arange(1, cars + actors + 1), per_car)]).astype(np.uint32)
    nodes = np.where(ids > cars, ids - cars, 0).astype(np.uint16)
    codewords = (ids % 3 + 10).astype(np.uint32)
    return Scene(
        _gaussians(rng, means),
        ids,
        codewords,
        nodes,
        build_instance_table(ids, means, codewords, nodes, {}, {1: "Car", 2: "Bus"}),
        tuple(_track(rng, number) for number in range(actors)),
        code_bits=4,
        extra={"confidence": rng.random(count).astype(np.float32)},
    )


def _gaussians(rng: np.random.Generator, means: np.ndarray) -> Gaussians:
    count = len(means)
    return Gaussians(
        means=means,
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        log_scales=rng.normal(-2, 0.4, (count, 3)).astype(np.float32),
        opacity_logits=rng.normal(2, 1, count).astype(np.float32),
        sh_dc=rng.normal(0, 1, (count, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.2, (count, REST_COUNTS[1], 3)).astype(np.float32),
        features=rng.normal(size=(count, 4)).astype(np.float32),
    )


def _track(rng: np.random.Generator, number: int) -> Track:
    """Half a second straight along the street."""
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, :3, 3] = [2.0 * number - 1.0, rng.uniform(-10, 10), CAR[2] / 2]
    poses[:, 1, 3] += np.linspace(0, 4, 6)
    return Track(f"actor-{number}", "Car", CAR.copy(), 0.1 * np.arange(6), poses, moving=True)
