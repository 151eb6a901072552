"""A car of which a drive has seen one side."""

import numpy as np

from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

CAR = 3
PLACE, TURN = np.array([4.0, -2.0]), 0.7
"""Where the middle of the car is, and where it heads."""


def car_surface(rng, count):
    """Points of a car's outside in its own axes (x ahead), and colours that tell its parts apart."""
    points = rng.uniform(-1, 1, (count, 3))
    face = rng.integers(0, 5, count)
    for number, (axis, sign) in enumerate([(0, 1), (0, -1), (1, 1), (1, -1), (2, 1)]):
        points[face == number, axis] = sign
    points *= [2.2, 0.9, 0.5]
    cabin = rng.uniform(-1, 1, (count // 3, 3)) * [1.0, 0.8, 0.35] + [-0.3, 0.0, 0.85]
    cabin[:, 1] = np.where(rng.random(len(cabin)) < 0.3, 0.8 * np.sign(cabin[:, 1]), cabin[:, 1])
    points = np.concatenate([points, cabin]) + np.array([0.0, 0.0, 0.7])
    colors = np.where(points[:, 2:] > 1.25, [0.1, 0.1, 0.15], [0.7, 0.1, 0.1])
    colors[points[:, 0] > 2.0] = [0.9, 0.9, 0.8]
    colors[points[:, 0] < -2.0] = [0.5, 0.0, 0.0]
    return points, colors


def half_seen_car(seed=0, seen=-1):
    """A car seen from one side: there all of it, elsewhere only what is near the roof, the front or the back."""
    rng = np.random.default_rng(seed)
    points, colors = car_surface(rng, 5000)
    far = points[:, 1] * seen < -0.55
    kept = ~far | (rng.random(len(points)) < 0.03)
    haze = rng.uniform(-1, 1, (60, 3)) * [1.5, 0.6, 0.5] + [0.0, -1.3 * seen, 0.8]
    means = np.concatenate([points[kept], haze])
    colors = np.concatenate([colors[kept], np.tile([0.1, 0.2, 0.8], (60, 1))])
    axes = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    means[:, :2] = means[:, :2] @ axes + PLACE
    return scene_of(rng, means, colors, np.full(len(means), CAR, np.uint32))


def scene_of(rng, means, colors, ids):
    count = len(means)
    quats = rng.normal(size=(count, 4))
    gaussians = Gaussians(
        means.astype(np.float32),
        (quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        np.log(rng.uniform(0.02, 0.08, (count, 3))).astype(np.float32),
        logit(np.full(count, 0.8)).astype(np.float32),
        dc_from_color(colors).astype(np.float32),
        rng.normal(0, 0.05, (count, 8, 3)).astype(np.float32),
        np.zeros((count, 0), np.float32),
    )
    words = np.zeros(count, np.uint32)
    nodes = np.zeros(count, np.uint16)
    table = build_instance_table(ids, gaussians.means, words, nodes, {CAR: "Car 3"}, {CAR: "Car"})
    return Scene(gaussians, ids, words, nodes, table=table)
