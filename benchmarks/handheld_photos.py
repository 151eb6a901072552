"""Photos as somebody with a camera takes them in a synthetic street: around a parked car, and on a walk."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image

from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.sensors.render import EXPOSURE, StepRenderer
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.scene.camera import Camera, look_at

KINDS = ("orbit", "walk")
WIDTH, HEIGHT, FOCAL = 480, 320, 420.0
_SWAY = 0.12
"""Metres by which hands and steps move the camera."""
_RADIUS, _ARC = 5.0, np.radians(130)
"""Radius and angle of the way around a car, on the side of the road; metres and radians."""
_AHEAD = 8.0
"""Metres before the recording car where the car stands that is photographed."""
_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def write_handheld_photos(out: Path, kind: str, seed: int, count: int) -> None:
    """Write `count` photos of street `seed` as a nerfstudio folder without points. The street stands still.

    Args:
        out: new folder.
        kind: one of `KINDS`.
        seed: of the street and of how the camera sways.
        count: of the photos.
    """
    street, rng = build_street(StreetConfig(seed=seed)), np.random.default_rng(seed)
    poses = _go_around(street, rng, count) if kind == "orbit" else _walk_past(street, rng, count)
    renderer = StepRenderer(street.geometry(0.0), street.materials, street.light)
    (out / "images").mkdir(parents=True)
    frames = []
    for number, pose in enumerate(poses):
        camera = Camera(FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT, pose)
        photo = renderer.photograph(camera, EXPOSURE * float(np.exp(0.03 * np.sin(0.7 * number))))
        name = f"images/{number:03d}.jpg"
        Image.fromarray(photo.image).save(out / name, quality=95)
        frames.append({"file_path": name, "transform_matrix": (pose @ _OPENGL).tolist()})
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT}
    (out / "transforms.json").write_text(json.dumps({"camera_model": "PINHOLE", **lens, "frames": frames}))


def _go_around(street: Street, rng: np.random.Generator, count: int) -> list[Float64[ndarray, "4 4"]]:
    """Around the parked car that is nearest to a place ahead, on the side of the road."""
    ego = compute_ego_pose(street, 0.0)
    place, forward = ego[:3, 3] * [1, 1, 0], ego[:3, 1]
    parked = [street.box_pose(actor, 0.0)[:3, 3] for actor in street.actors if actor.label == "Car"]
    standing = [center for center in parked if abs((center - place) @ ego[:3, 0]) > 2]
    center = min(standing, key=lambda one: abs((one - place) @ forward - _AHEAD))
    toward = place + forward * ((center - place) @ forward) - center
    middle = float(np.arctan2(toward[1], toward[0]))
    sway, gaze = _sway(rng, count), _sway(rng, count)
    poses = []
    for number, share in enumerate(np.linspace(-0.5, 0.5, count)):
        angle = middle + share * _ARC
        height = 0.9 + 0.4 * np.sin(7 * share)
        position = center + [_RADIUS * np.cos(angle), _RADIUS * np.sin(angle), height] + sway[number]
        poses.append(look_at(position, center + 1.5 * gaze[number]))
    return poses


def _walk_past(street: Street, rng: np.random.Generator, count: int) -> list[Float64[ndarray, "4 4"]]:
    """Nine metres along the road, looking at its right side."""
    ego = compute_ego_pose(street, 0.0)
    forward, right = ego[:3, 1], ego[:3, 0]
    start = ego[:3, 3] * [1, 1, 0] + 3 * forward - 1.5 * right + [0, 0, 1.6]
    sway, gaze = _sway(rng, count), 2 * _sway(rng, count)
    poses = []
    for number, share in enumerate(np.linspace(0, 1, count)):
        position, angle = start + 9 * share * forward + sway[number], 0.9 + gaze[number, 0]
        view = np.cos(angle) * forward + np.sin(angle) * right + [0, 0, 0.1 * gaze[number, 1] - 0.08]
        poses.append(look_at(position, position + view))
    return poses


def _sway(rng: np.random.Generator, count: int) -> Float64[ndarray, "n 3"]:
    """Smooth random shifts, metres."""
    window = np.hanning(13)
    noise = rng.normal(0, 1, (count + len(window) - 1, 3))
    smooth = [np.convolve(noise[:, axis], window / np.linalg.norm(window), "valid") for axis in range(3)]
    return _SWAY * np.stack(smooth, axis=1)
