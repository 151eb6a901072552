"""The ground of a whole model is mended: Gaussians of any shape, and actors in frames of their own."""

import numpy as np
import torch

from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.instances.ground_mending import mend_ground

ROAD, FAR_ROAD, CAR, MOVING = range(4)
UPRIGHT, FLAT = (np.cos(np.pi / 4), 0, np.sin(np.pi / 4), 0), (1, 0, 0, 0)


def grid(x, y, height):
    """Points 20 cm apart over two spans."""
    places = np.stack(np.meshgrid(np.arange(*x, 0.2), np.arange(*y, 0.2)), axis=-1).reshape(-1, 2)
    return np.column_stack([places, np.full(len(places), height)]).astype(np.float32)


def street():
    """A road in two groups, a parked car with its shadow in one, and an actor whose frame lies below the road's."""
    road, far = grid((0, 10), (0, 8), 0.02), grid((10, 20), (0, 8), 0.02)
    body = np.concatenate([grid((3, 7), (2, 4), height) for height in (0.05, 0.6, 1.0, 1.4)])
    parts = [road, far, body, grid((-2, 2), (-1, 1), 0.0)]
    groups = np.repeat([ROAD, FAR_ROAD, CAR, MOVING], [len(part) for part in parts])
    means = np.concatenate(parts)
    shadow = (groups == ROAD) & (np.abs(means[:, 0] - 5) < 3) & (np.abs(means[:, 1] - 3) < 2)
    groups[shadow] = CAR
    count = len(groups)
    quats = np.where((groups == CAR)[:, None] & ~shadow[:, None], UPRIGHT, FLAT).astype(np.float32)
    gaussians = Gaussians(
        means=means,
        quats=quats,
        log_scales=np.log(np.tile(np.float32([0.1, 0.1, 0.005]), (count, 1))),
        opacity_logits=np.full(count, 3, np.float32),
        sh_dc=np.full((count, 3), (0.3 - 0.5) / Y0, np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
    nodes = (groups == MOVING).astype(np.uint16)
    poses = np.tile(np.eye(4), (2, 1, 1))
    track = Track("other", "Car", np.array([2.0, 4.0, 1.5]), np.array([0.0, 1.0]), poses, moving=True)
    model = build_model(gaussians, nodes, (track,), np.zeros((6, 2, 2, 3), np.float32), [0.0, 1.0])
    return model, groups, shadow, np.concatenate([road, far])


def test_the_road_is_one_with_the_shadow_and_what_stands_or_moves_is_not_part_of_it():
    model, groups, shadow, ground = street()
    nothing = np.full(len(groups), -1)
    mended = mend_ground(groups, np.ones(len(groups), np.float32), model, ground, nothing)
    road = mended[0]
    assert set(mended[groups == FAR_ROAD].tolist()) == {road}
    assert set(mended[shadow].tolist()) == {road}
    stands = (groups == CAR) & ~shadow  # its lowest Gaussians are as low as the shadow, but upright
    assert set(mended[stands].tolist()) == {CAR}
    assert set(mended[groups == MOVING].tolist()) == {MOVING}


def test_a_hydrant_in_the_mask_of_the_road_is_a_thing_of_its_own():
    model, groups, _, ground = street()
    hydrant = np.flatnonzero(groups == ROAD)[:12]
    with torch.no_grad():
        model.parameters["means"][hydrant, 2] = torch.linspace(0.1, 0.7, 12)
    things = np.full(len(groups), -1)
    things[hydrant] = 5
    mended = mend_ground(groups, np.ones(len(groups), np.float32), model, ground, things)
    assert set(mended[hydrant].tolist()).isdisjoint(mended[np.setdiff1d(np.arange(len(groups)), hydrant)].tolist())
    assert len(set(mended[hydrant].tolist())) == 1
