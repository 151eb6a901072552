"""A small street of Gaussians whose every instance is known: road, houses, trees, parked cars, one driving car."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track

ROAD, HOUSES, FIRST_CAR, DRIVING_CAR = 1, 2, 10, 20
SHARED_CODEWORD = 37
"""Carried by the first two parked cars: a collision of the codebook."""
CAR_COLORS = ((0.75, 0.08, 0.08), (0.10, 0.25, 0.65), (0.85, 0.85, 0.82), (0.12, 0.12, 0.13), (0.80, 0.60, 0.10))


@dataclass
class Part:
    """Gaussians of one instance."""

    gaussians: Gaussians
    instance: int
    codeword: int
    node: int = 0


def float32_gaussians(*arrays):
    """Gaussians from arrays of any float type."""
    return Gaussians(*(np.asarray(array, np.float32) for array in arrays))


def plane(rng, origin, u, v, spacing, color, noise=0.06, sh_rest=3):
    """Flat Gaussians on a rectangle from `origin` along vectors `u` and `v`, about `spacing` metres apart."""
    origin, u, v = (np.asarray(x, float) for x in (origin, u, v))
    counts = [max(2, round(np.linalg.norm(w) / spacing)) for w in (u, v)]
    s, t = np.meshgrid((np.arange(counts[0]) + 0.5) / counts[0], (np.arange(counts[1]) + 0.5) / counts[1])
    s, t = s.ravel(), t.ravel()
    jitter = rng.normal(0, 0.12 * spacing, (len(s), 2))
    axes = np.stack([u / np.linalg.norm(u), v / np.linalg.norm(v)])
    means = origin + s[:, None] * u + t[:, None] * v + jitter @ axes
    frame = np.stack([axes[0], axes[1], np.cross(axes[0], axes[1])], axis=1)
    count = len(means)
    colors = np.broadcast_to(color(means) if callable(color) else np.asarray(color), (count, 3))
    colors = np.clip(colors * (1 + rng.normal(0, noise, (count, 1))), 0.01, 0.99)
    return float32_gaussians(
        means,
        np.tile(quaternion_from_matrix(frame), (count, 1)),
        np.log(np.tile([0.62 * spacing, 0.62 * spacing, 0.02], (count, 1))),
        logit(np.clip(rng.normal(0.9, 0.05, count), 0.5, 0.985)),
        dc_from_color(colors),
        rng.normal(0, 0.02, (count, sh_rest, 3)),
        np.zeros((count, 0)),
    )


def box(rng, low, high, spacing, color):
    """The five visible faces of a box."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    x, y, z = np.diag(high - low)
    shade = np.asarray(color)
    return [
        plane(rng, low, y, z, spacing, shade * 0.8),
        plane(rng, low + x, z, y, spacing, shade * 0.9),
        plane(rng, low, z, x, spacing, shade * 0.7),
        plane(rng, low + y, x, z, spacing, shade * 0.75),
        plane(rng, low + z, x, y, spacing, shade),
    ]


def car(rng, spacing, color):
    """A car of 1.8 × 4.4 × 1.5 m around the origin, driving along +y: body, cabin, wheels, lamps."""
    parts = box(rng, (-0.9, -2.2, -0.5), (0.9, 2.2, 0.15), spacing, color)
    parts += box(rng, (-0.75, -1.3, 0.15), (0.75, 0.9, 0.75), spacing, (0.12, 0.14, 0.17))
    parts.append(plane(rng, (-0.72, -1.2, 0.77), (1.44, 0, 0), (0, 2.0, 0), spacing, color))
    for x in (-0.92, 0.78):
        for y in (-1.6, 1.1):
            parts += box(rng, (x, y, -0.75), (x + 0.14, y + 0.6, -0.2), spacing, (0.03, 0.03, 0.03))
    for x in (-0.8, 0.5):
        parts.append(plane(rng, (x, -2.22, -0.1), (0.3, 0, 0), (0, 0, 0.15), spacing / 2, (0.8, 0.05, 0.05)))
    return concatenate_gaussians(parts)


def road_color(points):
    """Asphalt with a dashed centre line."""
    line = (np.abs(points[:, 0]) < 0.12) & (points[:, 1] % 4 < 2)
    return np.where(line[:, None], [0.85, 0.85, 0.8], [0.24, 0.24, 0.26])


def facade_color(points):
    """Brick with dark windows."""
    window = (points[:, 1] % 3 > 1.2) & (points[:, 2] % 3 > 1.1) & (points[:, 2] > 1)
    return np.where(window[:, None], [0.16, 0.20, 0.26], [0.58, 0.38, 0.30])


def tree(rng, x, y):
    """A trunk and a ball of leaves."""
    count = 220
    leaves = rng.normal(0, 1, (count, 3))
    leaves *= (rng.random((count, 1)) ** 0.33) / np.linalg.norm(leaves, axis=1, keepdims=True)
    trunk = box(rng, (x - 0.12, y - 0.12, 0), (x + 0.12, y + 0.12, 2.4), 0.16, (0.30, 0.21, 0.14))
    crown = float32_gaussians(
        leaves * 1.3 + [x, y, 3.2],
        rng.normal(0, 1, (count, 4)),
        np.log(rng.uniform(0.08, 0.22, (count, 3))),
        logit(rng.uniform(0.5, 0.95, count)),
        dc_from_color(np.array([0.16, 0.34, 0.10]) * rng.uniform(0.6, 1.5, (count, 1))),
        np.zeros((count, 3, 3)),
        np.zeros((count, 0)),
    )
    return concatenate_gaussians([*trunk, crown])


def parts_of(rng, spacing):
    """Everything with its instance, codeword and node."""
    length = 44.0
    parts = [
        Part(plane(rng, (-4, -4, 0), (8, 0, 0), (0, length, 0), 2 * spacing, road_color), ROAD, 1),
        Part(plane(rng, (-7, -4, 0.1), (3, 0, 0), (0, length, 0), 2 * spacing, (0.52, 0.50, 0.47)), 3, 3),
        Part(plane(rng, (4, -4, 0.1), (3, 0, 0), (0, length, 0), 2 * spacing, (0.52, 0.50, 0.47)), 4, 4),
        Part(plane(rng, (-7, -4, 0), (0, length, 0), (0, 0, 9), 2.5 * spacing, facade_color), HOUSES, 2),
        Part(plane(rng, (7, -4, 0), (0, 0, 9), (0, length, 0), 2.5 * spacing, facade_color), HOUSES + 3, 5),
    ]
    for number, (x, y) in enumerate([(-3, 4), (3, 8), (-3, 13), (3, 18), (-3, 24)]):
        body = car(rng, spacing, CAR_COLORS[number])
        body.means += np.array([x, y, 0.75], np.float32)
        codeword = SHARED_CODEWORD if number < 2 else 40 + number
        parts.append(Part(body, FIRST_CAR + number, codeword))
    for number, (x, y) in enumerate([(-5.3, 8), (5.3, 13), (-5.3, 19), (5.3, 25)]):
        parts.append(Part(tree(rng, x, y), 30 + number, 60 + number))
    parts.append(Part(car(rng, spacing, (0.15, 0.5, 0.35)), DRIVING_CAR, 50, node=1))
    return parts


def driving_track():
    """Along the right lane at 5 m/s for four seconds."""
    times = np.arange(9) * 0.5
    poses = np.tile(np.eye(4), (9, 1, 1))
    poses[:, :3, 3] = np.stack([np.full(9, 1.2), 9 + 5 * times * 0.6, np.full(9, 0.75)], axis=1)
    return Track("driver", "Car", np.array([1.8, 4.4, 1.5]), times, poses, moving=True)


def dataset_views():
    """A front camera that drives along, and a side camera."""
    views = []
    for index in range(4):
        front = look_at(np.array([-0.6, -1.5 + 0.8 * index, 2.0]), np.array([0.3, 10 + 0.8 * index, 0.6]))
        side = look_at(np.array([-0.6, 2 + 0.8 * index, 2.2]), np.array([6.0, 9 + 0.8 * index, 0.5]))
        for name, pose in (("front_camera", front), ("right_camera", side)):
            camera = Camera(400.0, 400.0, 240.0, 135.0, 480, 270, pose)
            views.append(CameraView(camera, name, index, index * 0.5))
    return tuple(views)


def evening_sky(resolution=32):
    """Blue above, pale at the horizon."""
    place = (np.arange(resolution) + 0.5) / resolution * 2 - 1
    v, u = np.meshgrid(place, place, indexing="ij")
    faces = []
    for axis in range(3):
        for sign in (1, -1):
            ray = np.zeros((resolution, resolution, 3))
            ray[..., axis], ray[..., (axis + 1) % 3], ray[..., (axis + 2) % 3] = sign, u, v
            height = (ray[..., 2] / np.linalg.norm(ray, axis=-1)).clip(0, 1)[..., None] ** 0.6
            faces.append((1 - height) * [0.86, 0.88, 0.90] + height * [0.30, 0.50, 0.78])
    return Sky(np.stack(faces).astype(np.float32))


def procedural_street(spacing: float = 0.16, seed: int = 3) -> Scene:
    """About 17,000 Gaussians at the default `spacing` (metres); the count grows with its inverse square."""
    rng = np.random.default_rng(seed)
    parts = parts_of(rng, spacing)
    ids, codewords, nodes = (
        np.concatenate([np.full(len(part.gaussians), getattr(part, name)) for part in parts])
        for name in ("instance", "codeword", "node")
    )
    gaussians = concatenate_gaussians([part.gaussians for part in parts])
    ids, codewords, nodes = ids.astype(np.uint32), codewords.astype(np.uint32), nodes.astype(np.uint16)
    names = {ROAD: "road", HOUSES: "houses left", HOUSES + 3: "houses right", 3: "pavement left", 4: "pavement right"}
    names |= {FIRST_CAR + k: f"parked car {k + 1}" for k in range(5)} | {30 + k: f"tree {k + 1}" for k in range(4)}
    classes = {key: name.split()[0].capitalize() for key, name in names.items()}
    classes |= {FIRST_CAR + k: "Car" for k in range(5)} | {DRIVING_CAR: "Car"}
    table = build_instance_table(ids, gaussians.means, codewords, nodes, names | {DRIVING_CAR: "driving car"}, classes)
    return Scene(
        gaussians, ids, codewords, nodes, table, (driving_track(),), evening_sky(), dataset_views(), code_bits=8
    )
