"""The whole trainer on a tiny scene whose photos the rasterizer itself drew."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from instdrive_core.instances.codebook import quantized
from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.training.checkpoint import load_checkpoint, restore, save_checkpoint
from instdrive_core.training.config import TrainConfig, on_frozen_geometry, train_config
from instdrive_core.training.draw import GEOMETRY
from instdrive_core.training.events import CheckpointDue, Refined, StepDone
from instdrive_core.training.model import model_from_gaussians
from instdrive_core.training.trainer import Trainer, TrainingDivergedError
from instdrive_core.training.view_store import ViewStore
from instdrive_core.training.views import TrainingView

OBJECTS = np.array([[-2.0, 6, 0.5], [2.0, 6, 0.5], [0, 9, 0.5]])
COLORS = np.array([[0.9, 0.2, 0.1], [0.1, 0.7, 0.2], [0.2, 0.3, 0.9]])


def blobs(rng: np.random.Generator, count: int = 120) -> tuple[Gaussians, np.ndarray]:
    """Three clusters of small Gaussians; returns them and each one's object number from 1."""
    which = np.repeat(np.arange(3), count // 3)
    means = OBJECTS[which] + rng.uniform(-0.6, 0.6, (len(which), 3))
    size = len(which)
    return (
        Gaussians(
            means=means.astype(np.float32),
            quats=np.tile(np.array([1, 0, 0, 0], np.float32), (size, 1)),
            log_scales=np.full((size, 3), np.log(0.18), np.float32),
            opacity_logits=np.full(size, 2.0, np.float32),
            sh_dc=((COLORS[which] - 0.5) / 0.28209479).astype(np.float32),
            sh_rest=np.zeros((size, 3, 3), np.float32),
            features=rng.normal(0, 0.1, (size, 4)).astype(np.float32),
        ),
        which + 1,
    )


def photographed(gaussians: Gaussians, which: np.ndarray, seed: int) -> list[TrainingView]:
    """Four photos with shuffled masks."""
    rng = np.random.default_rng(seed)
    views = []
    for number, x in enumerate((-1.5, -0.5, 0.5, 1.5)):
        pose = look_at(np.array([x, 0, 1.2]), np.array([0, 7.0, 0.5]))
        camera = Camera(60.0, 60.0, 32.0, 24.0, 64, 48, pose)
        colors = 0.5 + 0.28209479 * gaussians.sh_dc
        owner = np.eye(3, dtype=np.float32)[which - 1]
        raster = render(
            gaussians.means,
            gaussians.quats,
            gaussians.log_scales,
            gaussians.opacities,
            np.concatenate([colors, owner], axis=1).astype(np.float32),
            camera,
        )
        labels = rng.permutation(3)[raster.image[..., 3:].argmax(axis=2)] + 1
        labels = np.where(raster.alpha > 0.5, labels, 0).astype(np.uint16)
        image = raster.image[..., :3] + 0.6 * (1 - raster.alpha[..., None])
        known = np.flatnonzero(raster.alpha > 0.9).astype(np.int32)
        depth = (raster.depth / np.maximum(raster.alpha, 1e-6)).ravel()[known].astype(np.float32)
        photo = (image.clip(0, 1) * 255).round().astype(np.uint8)
        sky = raster.alpha < 0.01
        views.append(
            TrainingView(f"front_camera/{number:02d}", camera, 0.1 * number, photo, None, labels, sky, known, depth)
        )
    return views


def tiny_config(schedule: str = "after") -> TrainConfig:
    config = train_config("instdrive" if schedule == "after" else "paper", "demo", seed=3)
    return replace(
        config,
        geometry=replace(config.geometry, iterations=30, coarse_iterations=8, sky_resolution=8),
        instances=replace(config.instances, learned_by="losses", iterations=60, feature_dim=4, pixels_per_view=300),
        checkpoint_every=20,
        report_every=5,
    )


def new_trainer(config: TrainConfig) -> tuple[Trainer, np.ndarray]:
    rng = np.random.default_rng(0)
    truth, which = blobs(rng)
    views = photographed(truth, which, 1)
    start = truth.copy()
    start.sh_dc += rng.normal(0, 0.6, start.sh_dc.shape).astype(np.float32)
    sky = np.full((6, 8, 8, 3), 0.5, np.float32)
    model = model_from_gaussians(start, np.zeros(len(which), np.uint16), (), sky, [view.time for view in views])
    return Trainer(model, ViewStore.of(views), config, scene_radius=10.0), which


@pytest.mark.parametrize("schedule", ["after", "joint"])
def test_colour_improves_and_every_object_gets_one_code(schedule):
    config = tiny_config(schedule)
    if schedule == "joint":
        config = replace(
            config,
            geometry=replace(config.geometry, iterations=120),
            instances=replace(config.instances, feature_lr=0.05, tanh=True, repulsion_offset=1.0),
        )
    trainer, which = new_trainer(config)
    steps = [event for event in trainer.run() if isinstance(event, StepDone)]
    rgb = [event.psnr for event in steps if event.stage == "rgb"]
    assert rgb[-1] > rgb[0] + 2
    codes = quantized(trainer.model.gaussians().features)
    majority = [np.bincount(codes[which == number]).argmax() for number in (1, 2, 3)]
    assert len(set(majority)) == 3
    assert np.mean(codes == np.array(majority)[which - 1]) > 0.9


def test_instance_losses_leave_geometry_and_colour_alone():
    """The RGB stage must give the same bits whether instance losses ride along or not."""
    joint, _ = new_trainer(tiny_config("joint"))
    alone, _ = new_trainer(tiny_config("after"))
    for _ in range(12):
        joint.rgb_step()
        alone.rgb_step()
        joint.iteration += 1
        alone.iteration += 1
    for name in GEOMETRY:
        one, other = joint.model.parameters[name], alone.model.parameters[name]
        np.testing.assert_allclose(one, other, atol=2e-5, err_msg=name)
    for name in ("sky", "exposures"):
        one, other = joint.model.shared[name].detach(), alone.model.shared[name].detach()
        np.testing.assert_allclose(one, other, atol=2e-5, err_msg=name)
    assert not torch.equal(joint.model.parameters["features"], alone.model.parameters["features"])


def growing(config: TrainConfig) -> TrainConfig:
    """The same with densification and a reset of the opacities within the few steps there are."""
    densify = replace(
        config.densify,
        start=4,
        every=5,
        stop=0.7,
        gradient_threshold=1e-7,
        max_gaussians=200,
        reset_every=9,
        prune_opacity=0.01,
    )
    return replace(config, densify=densify)


@pytest.mark.parametrize("schedule", ["after", "joint"])
@pytest.mark.parametrize("stop_after", [1, 2, 3])
def test_a_resumed_run_ends_bit_equal(tmp_path, stop_after, schedule):
    config = growing(tiny_config(schedule))
    config = replace(config, checkpoint_every=12)
    whole, _ = new_trainer(config)
    grown = [event for event in whole.run() if isinstance(event, Refined)]
    assert sum(event.cloned + event.split for event in grown) > 0

    first, _ = new_trainer(config)
    due = 0
    for event in first.run():
        if isinstance(event, CheckpointDue):
            save_checkpoint(tmp_path / "part.safetensors", first)
            due += 1
            if due == stop_after:
                break
    checkpoint = load_checkpoint(tmp_path / "part.safetensors")
    second = Trainer(checkpoint.model(first.store.times), first.store, config, checkpoint.scene_radius)
    restore(second, checkpoint)
    for _ in second.run():
        pass
    for name, value in {**whole.model.parameters, **whole.model.shared}.items():
        assert torch.equal(value, {**second.model.parameters, **second.model.shared}[name]), name


def test_frozen_geometry_learns_instances_alone():
    config = on_frozen_geometry(tiny_config())
    trainer, which = new_trainer(config)
    before = {name: trainer.model.parameters[name].clone() for name in GEOMETRY}
    stages = {event.stage for event in trainer.run() if isinstance(event, StepDone)}
    assert stages == {"instances"}
    for name, value in before.items():
        assert torch.equal(value, trainer.model.parameters[name]), name
    codes = quantized(trainer.model.gaussians().features)
    assert len({int(np.bincount(codes[which == number]).argmax()) for number in (1, 2, 3)}) == 3


def test_a_parameter_that_is_no_number_is_not_saved():
    trainer, _ = new_trainer(tiny_config())
    events = trainer.run()
    next(events)
    trainer.model.parameters["means"][0] = float("nan")  # culled from now on: no loss would tell
    saved = []
    with pytest.raises(TrainingDivergedError, match="means is not finite"):
        saved.extend(event for event in events if isinstance(event, CheckpointDue))
    assert not saved


def test_a_loss_that_is_no_number_stops_the_run():
    trainer, _ = new_trainer(tiny_config())
    trainer.model.parameters["sh_dc"][:] = float("nan")
    with pytest.raises(TrainingDivergedError, match="rgb loss is nan at step 0"):
        trainer.rgb_step()


def test_empty_masks_train_colour_only():
    trainer, _ = new_trainer(tiny_config())
    views = [trainer.store.get(number) for number in range(len(trainer.store))]
    store = ViewStore.of([replace(view, labels=np.zeros_like(view.labels)) for view in views])
    empty = Trainer(trainer.model, store, trainer.config, 10.0)
    assert not empty.has_masks
    assert {event.stage for event in empty.run()} == {"rgb"}
