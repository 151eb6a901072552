"""A shadow that passes is learned with what casts it, and the road keeps its light."""

from dataclasses import replace

import numpy as np
from tiny_training import tiny_config

from instdrive_core.maths.spherical_harmonics import REST_COUNTS, color_from_dc, dc_from_color
from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.first_shadows import LONGEST, find_model_shadows, make_first_shadow
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

SIZE = np.array([1.6, 2.6, 1.2])
TIMES = np.arange(8) * 0.1
LIT = 0.6
CAMERA = Camera(60.0, 60.0, 32.0, 24.0, 64, 48, look_at(np.array([0, -6.0, 7.0]), np.array([0, 0.0, 0.0])))


def drive_past() -> Track:
    poses = np.tile(np.eye(4), (len(TIMES), 1, 1))
    poses[:, :3, 3] = [[0.0, -2 + 4 * time / TIMES[-1], SIZE[2] / 2] for time in TIMES]
    return Track("car", "Car", SIZE, TIMES, poses, moving=True)


def flat(places: np.ndarray, height: float, color: float, size: float = 0.25) -> Gaussians:
    count = len(places)
    return Gaussians(
        means=np.c_[places, np.full(count, height)].astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.tile(np.log([size, size, 0.01]), (count, 1)).astype(np.float32),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh_dc=dc_from_color(np.full((count, 3), color)).astype(np.float32),
        sh_rest=np.zeros((count, REST_COUNTS[1], 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )


def lattice(x: float, y: float, step: float) -> np.ndarray:
    axes = np.meshgrid(np.arange(-x, x + step / 2, step), np.arange(-y, y + step / 2, step), indexing="ij")
    return np.stack(axes, axis=-1).reshape(-1, 2)


def photograph(road: Gaussians, parts: list[Gaussians], pose: np.ndarray, step: int) -> TrainingView:
    """The road with a car and its shadow on it."""
    moved = [replace(part, means=part.means + pose[:3, 3].astype(np.float32)) for part in parts]
    scene = concatenate_gaussians([road, *moved])
    colors = color_from_dc(scene.sh_dc).astype(np.float32)
    raster = render(scene.means, scene.quats, scene.log_scales, scene.opacities, colors, CAMERA)
    photo = (raster.image.clip(0, 1) * 255).round().astype(np.uint8)
    none = np.zeros(0, np.int32)
    return TrainingView(
        f"front_camera/{step:02d}", CAMERA, float(TIMES[step]), photo, None, None, None, none, none.astype(np.float32)
    )


def train(with_shadow: bool) -> tuple[Trainer, np.ndarray]:
    """A road that is lit, a car without its shadow, photos with it; returns the trained road's brightness, too."""
    track, road = drive_past(), flat(lattice(3.5, 5.0, 0.4), 0.0, LIT)
    roof = flat(lattice(0.8, 1.2, 0.2), SIZE[2] / 2, 0.9, 0.12)
    shade = flat(lattice(0.8, 1.2, 0.2) + np.array([1.0, 0.0]), 0.03 - SIZE[2] / 2, 0.0, 0.2)
    shade.opacity_logits[:] = -1.3
    views = [photograph(road, [shade, roof], pose, step) for step, pose in enumerate(track.world_from_box)]
    parts = [road, roof, *([make_first_shadow(track, 1)] if with_shadow else [])]
    start = concatenate_gaussians(parts)
    nodes = np.where(np.arange(len(start)) < len(road), 0, 1).astype(np.uint16)
    store = ViewStore.from_views(views)
    model = build_model(start, nodes, (track,), np.zeros((6, 8, 8, 3), np.float32), store.times)
    config = tiny_config()
    geometry = replace(config.geometry, iterations=240, coarse_iterations=0, exposure_lr=0.0, rig_lr=0.0, photo_lr=0.0)
    config = replace(config, geometry=geometry, densify=replace(config.densify, max_gaussians=0))
    trainer = Trainer(model, store, config, 10.0)
    for iteration in range(240):
        trainer.iteration = iteration
        trainer.rgb_step()
    ground = model.parameters["means"].detach().numpy()[nodes == 0]
    way = (np.abs(ground[:, 0] - 1.0) < 0.9) & (np.abs(ground[:, 1]) < 2.0)
    colors = color_from_dc(model.parameters["sh_dc"].detach().numpy()[nodes == 0]).mean(axis=1)
    return trainer, colors[way]


def test_the_road_keeps_its_light_and_the_car_takes_its_shadow_along():
    _, without = train(False)
    trainer, colors = train(True)
    assert np.abs(colors - LIT).mean() < 0.4 * np.abs(without - LIT).mean()
    shadows = find_model_shadows(trainer.model)
    model = trainer.model
    places = model.parameters["means"].detach().numpy()
    weights = 1 / (1 + np.exp(-model.parameters["opacity_logits"].detach().numpy()))
    below = shadows & (np.abs(places[:, 0] - 1.4) < 0.3) & (np.abs(places[:, 1]) < 0.9)
    beside = shadows & (places[:, 0] < -1.2) & (np.abs(places[:, 1]) < 0.9)
    assert weights[below].mean() > 4 * weights[beside].mean()


def test_it_begins_faint_black_and_flat_around_the_foot():
    track = drive_past()
    shadow = make_first_shadow(track, 1)
    away = np.maximum(np.abs(shadow.means[:, :2]) - SIZE[:2] / 2, 0)
    assert 1.2 < np.hypot(*away.T).max() < 2.0
    assert (np.abs(shadow.means[:, 2] + SIZE[2] / 2) < 0.1).all()
    assert shadow.opacities.max() < 0.05
    np.testing.assert_allclose(color_from_dc(shadow.sh_dc), 0, atol=1e-6)
    assert not len(make_first_shadow(replace(track, dimensions=np.array([0.6, 1.8, 1.8])), 1))  # a bicycle
    tall = make_first_shadow(replace(track, dimensions=np.array([2.0, 8.0, 9.0])), 1)
    assert np.abs(tall.means[:, 0]).max() < 1.0 + LONGEST + 0.4
