"""Learnable exposures find the photos' own and do not drift together."""

from types import SimpleNamespace

import numpy as np
import torch

from instdrive_core.training.gaussians.exposures import export_exposures, exposure_penalty, make_initial_exposures


def test_identity_costs_nothing():
    exposures = make_initial_exposures(5)
    assert exposures.shape == (5, 3, 4)
    assert float(exposure_penalty(exposures, 2)) == 0


def test_steps_over_all_photos_descend_distances_and_their_mean():
    values = torch.randn(6, 3, 4, generator=torch.Generator().manual_seed(0))
    stepwise, whole = values.clone().requires_grad_(True), values.clone().requires_grad_(True)
    for photo in range(6):
        before = None if stepwise.grad is None else stepwise.grad.clone()
        exposure_penalty(stepwise, photo).backward()
        changed = stepwise.grad if before is None else stepwise.grad - before
        assert torch.nonzero(changed.flatten(1).any(dim=1)).tolist() == [[photo]], "other photos are left alone"
    changes = whole - torch.eye(3, 4)
    (changes.square().sum() + 6 * changes.mean(dim=0).square().sum()).div(12).backward()
    torch.testing.assert_close(stepwise.grad, whole.grad)


def test_photos_of_one_scene_get_their_differences_and_the_scene_their_average():
    generator = torch.Generator().manual_seed(1)
    truth = make_initial_exposures(8) + 0.1 * torch.randn(8, 3, 4, generator=generator)
    truth = truth - (truth.mean(dim=0) - torch.eye(3, 4))  # the mean photo shows the scene as it is
    scene = torch.rand(200, 3, generator=generator)
    colors, exposures = torch.full_like(scene, 0.5).requires_grad_(True), make_initial_exposures(8).requires_grad_(True)
    optimizer = torch.optim.Adam([colors, exposures], lr=0.01)
    for _ in range(800):
        loss = torch.zeros(())
        for photo in range(8):
            shown = colors @ exposures[photo, :, :3].T + exposures[photo, :, 3]
            goal = scene @ truth[photo, :, :3].T + truth[photo, :, 3]
            loss = loss + (shown - goal).square().mean() + 0.01 * exposure_penalty(exposures, photo)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert float((colors.detach() - scene).abs().mean()) < 0.02
    assert float((exposures.detach().mean(dim=0) - torch.eye(3, 4)).abs().max()) < 0.02
    assert float((exposures.detach() - truth).abs().mean()) < 0.02


def test_finished_exposures_are_found_by_camera_and_time():
    values = torch.randn(2, 3, 4, requires_grad=True)
    photos = [SimpleNamespace(key="front_camera/03", time=0.3), SimpleNamespace(key="front_camera/05", time=0.5)]
    finished = export_exposures(values, photos)
    np.testing.assert_array_equal(finished.interpolate("front_camera", 0.5), values[1].detach())
    np.testing.assert_allclose(finished.interpolate("front_camera", 0.4), values.detach().mean(dim=0), atol=1e-6)
