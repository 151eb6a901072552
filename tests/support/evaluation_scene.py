"""A toy drive with exact ground truth: a road, a parked and a driving box, a pole; labels are ray cast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from instdrive_core.datasets.clip import Clip, Frame, is_held_out
from instdrive_core.evaluation.metrics.box_pixels import find_box_silhouette
from instdrive_core.instances.table import build_instance_table
from instdrive_core.masks.ground_truth import GroundTruthInstance
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track

ROAD, PARKED, DRIVING, POLE = 1, 2, 3, 4
COLORS = np.array([[0.6, 0.7, 0.9], [0.3, 0.3, 0.3], [0.8, 0.1, 0.1], [0.1, 0.2, 0.8], [0.9, 0.8, 0.1]], np.float32)
"""Colours of sky, road, parked, driving, pole."""
SPACING, DEVIATION = 0.2, 0.1
ROAD_SIDE, ROAD_END = 8.0, 25.0
WIDTH, HEIGHT = 192, 108


def pose(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def track(name: str, size: tuple[float, float, float], start: float, end: float, x: float) -> Track:
    times = np.arange(21) / 10
    poses = np.stack([pose(x, y, size[2] / 2) for y in np.linspace(start, end, len(times))])
    return Track(name, "Car", np.array(size), times, poses, moving=start != end)


def box_surface(size: np.ndarray) -> np.ndarray:
    """Points on a box's surface, in its frame."""
    axes = [np.linspace(-s / 2, s / 2, max(2, round(s / SPACING) + 1)) for s in size]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return grid[(np.abs(np.abs(grid) - size / 2) < 1e-6).any(axis=1)]


def exact_labels(camera: Camera, boxes: list[tuple[int, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Nearest box per pixel, else the road where the ray meets it, else 0 for the sky."""
    rays = camera.compute_ray_directions()
    downward = np.minimum(rays[..., 2:], -1e-9)
    hits = camera.position - rays * camera.position[2] / downward
    on_road = (np.abs(hits[..., 0]) < ROAD_SIDE) & (hits[..., 1] > -ROAD_SIDE) & (hits[..., 1] < ROAD_END)
    labels = np.where(on_road & (rays[..., 2] < 0), ROAD, 0).astype(np.uint32)
    far_to_near = sorted(boxes, key=lambda box: -np.linalg.norm(box[1][:3, 3] - camera.position))
    for label, world_from_box, size in far_to_near:
        labels[find_box_silhouette(camera, world_from_box, size)] = label
    return labels


@dataclass
class ToyTruth:
    """Stands in for the ground truth of a clip."""

    labels: dict[str, np.ndarray]
    instances: dict[int, GroundTruthInstance]
    source: str = "exact"

    def load(self, frame: Frame) -> np.ndarray:
        return self.labels[frame.key]

    def load_sky(self, frame: Frame) -> np.ndarray:
        return self.labels[frame.key] == 0


@dataclass
class ToyDrive:
    scene: Scene
    clip: Clip
    truth: ToyTruth


def toy_scene(parked: Track, driving: Track, views: tuple[CameraView, ...]) -> Scene:
    """Perfect IDs: those of the ground truth. The driving box is an actor."""
    x, y = np.meshgrid(np.arange(-ROAD_SIDE, ROAD_SIDE, SPACING), np.arange(-5, ROAD_END, SPACING))
    road = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    parked_surface = box_surface(parked.dimensions) + parked.world_from_box[0, :3, 3]
    pole = np.stack([np.full(40, -3.0), np.full(40, 10.0), np.linspace(0, 4, 40)], -1)
    parts = [(ROAD, road), (PARKED, parked_surface), (POLE, pole), (DRIVING, box_surface(driving.dimensions))]
    means = np.concatenate([points for _, points in parts]).astype(np.float32)
    ids = np.concatenate([np.full(len(points), label, np.uint32) for label, points in parts])
    count = len(means)
    gaussians = Gaussians(
        means=means,
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), np.log(DEVIATION), np.float32),
        opacity_logits=logit(np.full(count, 0.95, np.float32)),
        sh_dc=dc_from_color(COLORS[ids]).astype(np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.stack([ids & 1, ids >> 1 & 1, ids >> 2 & 1], -1).astype(np.float32) * 2 - 1,
    )
    faces = np.broadcast_to(COLORS[0], (6, 2, 2, 3)).copy()
    nodes = (ids == DRIVING).astype(np.uint16)
    table = build_instance_table(ids, means, ids, nodes)
    return Scene(gaussians, ids, ids.copy(), nodes, table, (driving,), Sky(faces), views, code_bits=3)


def toy_drive() -> ToyDrive:
    """Eight time steps of two cameras; 4 and 14 are held out. IDs of the scene are the true ones."""
    parked = track("parked", (1.8, 4.0, 1.6), 8.0, 8.0, 2.5)
    driving = track("driving", (1.8, 4.0, 1.6), 6.0, 14.0, -0.5)
    poles = [(POLE, pose(-3, 10, 2), np.array([0.2, 0.2, 4.0]))]
    frames, labels = [], {}
    for index in range(0, 16, 2):
        time = index / 10
        for name, target in (("front", [0.0, 10.0, 0.5]), ("side", [3.0, 8.0, 0.5])):
            at = look_at(np.array([-1.0 if name == "front" else 0.5, -2.0 + 0.1 * index, 2.0]), np.array(target))
            camera = Camera(170.0, 170.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT, at)
            boxes = [(PARKED, parked.interpolate_pose(time), parked.dimensions), *poles]
            boxes.append((DRIVING, driving.interpolate_pose(time), driving.dimensions))
            seen = exact_labels(camera, boxes)
            photo = np.round(COLORS[seen] * 255).astype(np.uint8)
            valid = np.ones(seen.shape, bool)
            valid[-8:] = False
            view = CameraView(camera, name, index, time, held_out=is_held_out(index))
            frame = Frame(view, lambda photo=photo: photo, valid)
            labels[frame.key] = np.where(valid, seen, 0).astype(np.uint32)
            frames.append(frame)
    clip = Clip("toy", "toy", np.zeros(3), tuple(frames), (), (parked, driving), {}, ("front", "side"))
    instances = {
        ROAD: GroundTruthInstance(ROAD, "road", "Road", "stuff"),
        PARKED: GroundTruthInstance(PARKED, "parked", "Car", "thing", False, "parked"),
        DRIVING: GroundTruthInstance(DRIVING, "driving", "Car", "thing", True, "driving"),
        POLE: GroundTruthInstance(POLE, "pole", "Pole", "thing"),
    }
    scene = toy_scene(parked, driving, tuple(frame.view for frame in frames))
    return ToyDrive(scene, clip, ToyTruth(labels, instances))
