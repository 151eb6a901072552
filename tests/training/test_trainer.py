"""The whole trainer on a tiny scene whose photos the rasterizer itself drew."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_training import OBJECTS, new_trainer, tiny_config

from instdrive_core.instances.codebook import quantize_features
from instdrive_core.scene.track import Track
from instdrive_core.training.checkpoint import load_checkpoint, restore_trainer, save_checkpoint
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.gaussians.view_rendering import GEOMETRY
from instdrive_core.training.settings.config import TrainConfig, keep_geometry
from instdrive_core.training.settings.events import CheckpointDue, DensifyDone, StepDone
from instdrive_core.training.trainer import Trainer, TrainingDivergedError
from instdrive_core.training.views.view_store import ViewStore


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
    codes = quantize_features(trainer.model.gaussians().features)
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


def test_what_nobody_can_see_is_gone_once_colour_is_trained():
    trainer, which = new_trainer(tiny_config())
    with torch.no_grad():
        trainer.model.parameters["opacity_logits"][:5] = -12.0
        trainer.model.parameters["means"][7] = torch.tensor([900.0, 0, 0])
    counts = {event.stage: event.gaussians for event in trainer.run() if isinstance(event, StepDone)}
    assert len(trainer.model) == len(trainer.model.nodes) == len(which) - 6
    assert counts == {"rgb": len(which) - 6, "instances": len(which) - 6}


def test_what_moves_does_not_outgrow_its_box():
    still, which = new_trainer(tiny_config())
    times = np.linspace(0, 0.3, 4)
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, 3] = OBJECTS[0]
    track = Track("one", "Car", np.array([1.2, 1.2, 1.2]), times, poses, moving=True)
    gaussians = still.model.gaussians()
    gaussians.means[which == 1] -= OBJECTS[0].astype(np.float32)
    gaussians.log_scales[0] = np.log([3.0, 0.1, 2.0])
    nodes = (which == 1).astype(np.uint16)
    order = np.argsort(nodes, kind="stable")
    sky = np.full((6, 8, 8, 3), 0.5, np.float32)
    model = build_model(gaussians.select(order), nodes[order], (track,), sky, times.tolist())
    trainer = Trainer(model, still.store, tiny_config(), scene_radius=10.0)
    list(trainer.run())
    moving = trainer.model.nodes == 1
    sizes = trainer.model.gaussians().log_scales[moving].max(axis=1)
    assert moving.sum() == 40
    assert np.exp(sizes.max()) <= 0.45  # the box, a margin and what is turned


def growing(config: TrainConfig) -> TrainConfig:
    """Configuration with densification and a reset of the opacities within the few steps there are."""
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
    grown = [event for event in whole.run() if isinstance(event, DensifyDone)]
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
    restore_trainer(second, checkpoint)
    for _ in second.run():
        pass
    for name, value in {**whole.model.parameters, **whole.model.shared}.items():
        assert torch.equal(value, {**second.model.parameters, **second.model.shared}[name]), name


def test_frozen_geometry_learns_instances_alone():
    config = keep_geometry(tiny_config())
    trainer, which = new_trainer(config)
    before = {name: trainer.model.parameters[name].clone() for name in GEOMETRY}
    stages = {event.stage for event in trainer.run() if isinstance(event, StepDone)}
    assert stages == {"instances"}
    for name, value in before.items():
        assert torch.equal(value, trainer.model.parameters[name]), name
    codes = quantize_features(trainer.model.gaussians().features)
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
    store = ViewStore.from_views([replace(view, labels=np.zeros_like(view.labels)) for view in views])
    empty = Trainer(trainer.model, store, trainer.config, 10.0)
    assert not empty.has_masks
    stages = {event.stage for event in empty.run() if isinstance(event, StepDone)}
    assert stages == {"rgb"}
