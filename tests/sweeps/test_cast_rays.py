"""Rays cast into walls, boxes and things that drive: ranges, instances, edits, what returns nothing."""

import numpy as np
import pytest

from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.sweeps.cast import LidarRays, RayCaster
from instdrive_core.sweeps.kernels import LEAST_ALPHA, MOST_ALPHA, WINDOW
from instdrive_core.sweeps.pattern import Pattern
from instdrive_core.sweeps.rig import Rig

WALL, PANEL = 3, 5


def tile(center, across, up, size, spacing=0.2):
    """Flat splats on a square of a plane."""
    steps = np.arange(-size, size + 1e-6, spacing)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return center + grid[:, :1] * across + grid[:, 1:] * up


def make_scene(parts, ids, nodes=None, actors=(), alpha=6.0):
    """Splats that are 0.3 m wide and 1 cm thin along x."""
    means = np.concatenate(parts).astype(np.float32)
    count = len(means)
    gaussians = Gaussians(
        means=means,
        quats=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        log_scales=np.tile(np.log(np.float32([0.01, 0.3, 0.3])), (count, 1)),
        opacity_logits=np.full(count, alpha, np.float32),
        sh_dc=np.zeros((count, 3), np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
    numbers = np.repeat(ids, [len(part) for part in parts]).astype(np.uint32)
    nodes = np.repeat(nodes or [0] * len(parts), [len(part) for part in parts]).astype(np.uint16)
    table = build_instance_table(numbers, means, None, nodes)
    return Scene(gaussians, numbers, np.zeros(count, np.uint32), nodes, table, actors=tuple(actors))


Y, Z = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
FAR_WALL = tile(np.array([20.0, 0, 0]), Y, Z, 6.0)
NEAR_PANEL = tile(np.array([12.0, 0, 0]), Y, Z, 1.0)


def fan(count=400, spread=0.2, time=0.0, origin=(0.0, 0, 0)):
    rng = np.random.default_rng(0)
    directions = np.c_[np.ones(count), rng.uniform(-spread, spread, (count, 2))]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return LidarRays(np.tile(np.array(origin, float), (count, 1)), directions, np.full(count, time))


def test_ranges_are_those_of_the_planes_and_ids_those_of_what_was_met():
    scene = make_scene([FAR_WALL, NEAR_PANEL], [WALL, PANEL])
    rays = fan()
    found = RayCaster(scene).cast(rays)
    at = found.ranges[:, None] * rays.directions
    on_panel = (np.abs(12 * rays.directions[:, 1:] / rays.directions[:, :1]) < 0.7).all(axis=1)
    beside = (np.abs(12 * rays.directions[:, 1:] / rays.directions[:, :1]) > 2.0).any(axis=1)
    assert on_panel.sum() > 20
    np.testing.assert_allclose(at[on_panel, 0], 12, atol=0.02)
    np.testing.assert_allclose(at[beside, 0], 20, atol=0.02)
    assert set(scene.instance_ids[found.rows[on_panel]]) == {PANEL}
    assert set(scene.instance_ids[found.rows[beside]]) == {WALL}
    assert found.opacities[beside].min() > 0.5


def test_what_is_deleted_lets_rays_through():
    whole, left = make_scene([FAR_WALL, NEAR_PANEL], [WALL, PANEL]), make_scene([FAR_WALL], [WALL])
    rays = fan(spread=0.05)
    assert np.median(RayCaster(whole).cast(rays).ranges) == pytest.approx(12, abs=0.1)
    assert np.median(RayCaster(left).cast(rays).ranges) == pytest.approx(20, abs=0.1)


def test_sky_thin_haze_and_what_is_too_near_or_too_far_return_nothing():
    scene = make_scene([FAR_WALL], [WALL])
    up = fan()
    up.directions[:] = [0, 0, 1]
    assert np.isinf(RayCaster(scene).cast(up).ranges).all()
    rays = fan(spread=0.05)
    haze = RayCaster(make_scene([FAR_WALL], [WALL], alpha=-5.0)).cast(rays)
    assert np.isinf(haze.ranges).all()
    assert (haze.rows == -1).all()
    assert np.isinf(RayCaster(scene, far=15.0).cast(rays).ranges).all()
    assert np.isinf(RayCaster(scene, near=25.0).cast(rays).ranges).all()
    assert np.isfinite(RayCaster(scene, near=1.0, far=25.0).cast(rays).ranges).all()


def test_all_around_and_straight_down():
    """Tiles wrap behind the sensor and end at the poles."""
    behind = tile(np.array([-9.0, 0, 0]), Y, Z, 4.0)
    scene = make_scene([behind], [WALL])
    rays = fan(spread=0.1)
    rays.directions[:, 0] *= -1
    np.testing.assert_allclose(RayCaster(scene).cast(rays).ranges * rays.directions[:, 0], -9, atol=0.02)
    ground = make_scene([np.roll(tile(np.array([-2.0, 0, 0]), Y, Z, 3.0), -1, axis=1)], [WALL])
    ground.gaussians.log_scales[:] = np.log(np.float32([0.3, 0.3, 0.01]))
    down = fan(spread=0.3)
    down.directions[:] = np.roll(down.directions * [-1, 1, 1], -1, axis=1)
    np.testing.assert_allclose(RayCaster(ground).cast(down).ranges * down.directions[:, 2], -2, atol=0.02)


def test_each_ray_meets_what_drives_where_it_is_then():
    """A panel that comes nearer at 20 m/s, seen by rays over a tenth of a second; it is gone after its track."""
    times = np.array([0.0, 1.0])
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = -20.0
    track = Track("van", "Car", np.array([2.0, 2.0, 2.0]), times, poses, moving=True)
    scene = make_scene([NEAR_PANEL], [PANEL], nodes=[1], actors=[track])
    rays = fan(spread=0.03)
    rays.times[:] = np.linspace(0.1, 0.2, len(rays))
    found = RayCaster(scene).cast(rays)
    np.testing.assert_allclose(found.ranges * rays.directions[:, 0], 12 - 20 * rays.times, atol=0.03)
    rays.times[:] = 3.0
    assert np.isinf(RayCaster(scene).cast(rays).ranges).all()


def test_a_pattern_is_aimed_from_where_the_rig_is_at_each_time():
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 10.0
    rig = Rig(np.array([0.0, 1.0]), poses)
    delays = np.linspace(-0.05, 0.05, 7).astype(np.float32)
    pattern = Pattern(np.tile(np.float32([1, 0, 0]), (7, 1)), delays, np.array([0, 0, 0.5]))
    rays = pattern.aim(rig, 0.5)
    np.testing.assert_allclose(rays.origins[:, 0], 5 + 10 * delays, atol=1e-6)
    np.testing.assert_allclose(rays.origins[:, 2], 0.5)
    found = RayCaster(make_scene([FAR_WALL], [WALL])).cast(rays)
    np.testing.assert_allclose(found.ranges, 20 - rays.origins[:, 0], atol=0.02)


def test_no_rays_and_no_splats_give_no_returns():
    scene = make_scene([FAR_WALL], [WALL])
    assert len(RayCaster(scene).cast(fan(count=0)).ranges) == 0
    scene.gaussians.means[:] = np.nan
    assert np.isinf(RayCaster(scene).cast(fan(count=5)).ranges).all()


def test_splats_that_a_ray_meets_are_listed_from_near_to_far():
    scene, rays = make_scene([FAR_WALL, NEAR_PANEL], [WALL, PANEL], alpha=0.0), fan()
    caster = RayCaster(scene)
    met, found = caster.list_met(rays), caster.cast(rays)
    there = met.rows >= 0
    assert there.any(axis=1).all()
    assert (np.diff(np.where(there, met.depths, np.inf)[:, :4], axis=1) >= 0).all()
    assert (met.weights[~there] == 0).all()
    np.testing.assert_allclose(met.weights.sum(axis=1), found.opacities, atol=1e-5)


def test_a_return_is_the_mean_of_the_splats_about_it_by_the_light_that_they_take():
    sheets = [np.array([[x, 0.0, 0]]) for x in (20.0, 20.2, 21.0)]
    scene = make_scene(sheets, [WALL, WALL, PANEL])
    scene.gaussians.log_scales[:, 1:] = np.log(np.float32(3))
    opacities = np.array([0.4, 0.8, 0.9])
    scene.gaussians.opacity_logits[:] = np.log(opacities / (1 - opacities))
    rays = fan(count=1)
    rays.directions[:] = [1, 0, 0]
    found = RayCaster(scene).cast(rays)
    taken = np.array([0.4, 0.6 * 0.8])  # the third lies too far behind
    assert found.ranges[0] == pytest.approx(float(taken @ [20.0, 20.2] / taken.sum()), abs=1e-4)
    assert found.rows[0] == 1
    moved = RayCaster(scene, offsets=np.array([0.0, -0.1, 0.0], np.float32)).cast(rays)
    assert moved.ranges[0] == pytest.approx(float(taken @ [20.0, 20.1] / taken.sum()), abs=1e-4)


def cast_by_the_book(scene, rays, near=1.0, far=200.0):
    """Ranges of rays that look at every splat: equations of `sweeps.kernels`, without tiles."""
    gaussians = scene.gaussians
    whitening = np.exp(-gaussians.log_scales.astype(np.float64))[:, :, None] * np.swapaxes(
        matrix_from_quaternion(gaussians.quats.astype(np.float64)), 1, 2
    )
    alphas, found = 1 / (1 + np.exp(-gaussians.opacity_logits.astype(np.float64))), []
    for origin, direction in zip(rays.origins, rays.directions, strict=True):
        offset, along = whitening @ direction, np.einsum("nij,nj->ni", whitening, gaussians.means - origin)
        squared = (offset**2).sum(axis=1)
        weight = np.minimum(alphas * np.exp(-0.5 * (np.cross(along, offset) ** 2).sum(axis=1) / squared), MOST_ALPHA)
        depth = (along * offset).sum(axis=1) / squared
        order = np.argsort(depth)
        order = order[(weight[order] >= LEAST_ALPHA) & (depth[order] >= near) & (depth[order] <= far)]
        light = np.cumprod(np.r_[1.0, 1 - weight[order]])
        if light[-1] >= 0.5:
            found.append(np.inf)
            continue
        k = int(np.argmax(light[1:] < 0.5))
        median = depth[order[k - 1 if k and light[k] - 0.5 < 0.5 - light[k + 1] else k]]
        taken = light[:-1] * weight[order] * (np.abs(depth[order] - median) <= WINDOW)
        found.append(float((taken * depth[order]).sum() / taken.sum()))
    return np.array(found)


def test_flat_and_long_splats_all_around_are_met_as_without_tiles():
    rng, count = np.random.default_rng(1), 3000
    scene = make_scene([rng.normal(0, 3, (count, 3))], [WALL], alpha=3.0)
    scene.gaussians.quats[:] = normalize_quaternions(rng.normal(size=(count, 4)))
    scene.gaussians.log_scales[:] = np.log(rng.uniform(0.005, 0.05, (count, 3)) * rng.choice([1.0, 4.0], (count, 3)))
    directions = rng.normal(size=(600, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = LidarRays(rng.uniform(-0.3, 0.3, (600, 3)), directions, np.zeros(600))
    found, expected = RayCaster(scene).cast(rays).ranges, cast_by_the_book(scene, rays)
    same = np.isclose(found, expected, rtol=1e-4) | (np.isinf(found) & np.isinf(expected))
    assert 0.3 < np.isfinite(expected).mean() < 0.7
    # A splat whose weight is at the limit, or a depth at the window's, may fall on either side of it.
    assert same.mean() > 0.98
