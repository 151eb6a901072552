"""The mask tracker: one ID per thing through time and across cameras, whatever moves; faults get none."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.baselines.iou_tracker import TrackerConfig, track_masks
from instdrive_core.baselines.surface_points import find_surface_points
from instdrive_core.training.instances.instance_learner import cache_views
from instdrive_core.training.views.view_store import ViewStore


def true_ids(toy, cached):
    """The ground-truth ID of each mask of each cached view."""
    frames = {frame.key: frame for frame in toy.drive.clip.training_frames}
    for view in cached:
        truth = toy.drive.truth.load(frames[toy.store.facts[view.number].key]).ravel()[view.pixels]
        segment = view.segments.segment.numpy()
        yield [int(np.bincount(truth[segment == mask]).argmax()) for mask in range(view.segments.count)]


@pytest.fixture(scope="module")
def cached(toy):
    return cache_views(toy.model, toy.store, toy.config)


def test_every_thing_keeps_one_id_in_both_cameras(toy, cached):
    tracks = track_masks(toy.model, toy.store, cached, TrackerConfig())
    pairs = {
        (true, int(track))
        for truth, found in zip(true_ids(toy, cached), tracks.by_view, strict=True)
        for true, track in zip(truth, found, strict=True)
    }
    assert tracks.count == 4
    assert len(pairs) == 4
    assert {track for _, track in pairs} == {0, 1, 2, 3}


def test_points_lie_on_the_surfaces_that_the_photo_shows(toy, cached):
    view = cached[0]
    facts = toy.store.facts[view.number]
    points = find_surface_points(toy.model, view, facts.camera, facts.time)
    poses = toy.model.actor_poses.at(facts.time, toy.model.corrections)
    back = points.pixels_in(facts.camera, poses.matrices, poses.present)
    width = facts.camera.width
    assert np.abs(back // width - view.pixels // width).max() <= 1
    assert np.abs(back % width - view.pixels % width).max() <= 1
    (truth,) = list(true_ids(toy, [view]))
    road = view.segments.segment.numpy() == truth.index(1)
    assert np.median(np.abs(points.positions[road & (points.nodes == 0), 2])) < 0.2  # two deviations
    driving = view.segments.segment.numpy() == truth.index(3)
    assert (points.nodes[driving] == 1).mean() > 0.8
    half = toy.drive.scene.actors[0].dimensions / 2
    assert (np.abs(points.positions[driving & (points.nodes == 1)]) < half + 0.3).all()


def test_a_point_of_an_absent_actor_falls_on_no_pixel(toy, cached):
    view = cached[0]
    facts = toy.store.facts[view.number]
    points = find_surface_points(toy.model, view, facts.camera, facts.time)
    poses = toy.model.actor_poses.at(facts.time, toy.model.corrections)
    pixels = points.pixels_in(facts.camera, poses.matrices, np.array([True, False]))
    assert (pixels[points.nodes == 1] == -1).all()
    assert (pixels[points.nodes == 0] >= 0).any()


def test_a_dropped_mask_is_found_again_and_a_mask_seen_once_gets_none(toy):
    views = [toy.store.get(number) for number in range(len(toy.store))]
    changed = []
    for number, view in enumerate(views):
        labels = view.labels.copy()
        truth = toy.drive.truth.labels[view.key]
        if number in (2, 3, 4, 5):
            labels[truth == 2] = 0  # the parked car is missed in two time steps
        if number == 0:
            labels[:20, :20] = 9  # something nobody sees again
            labels[20:40, :20][truth[20:40, :20] == 1] = 9
        changed.append(replace(view, labels=labels))
    store = ViewStore.from_views(changed)
    cached = cache_views(toy.model, store, toy.config)
    tracks = track_masks(toy.model, store, cached, TrackerConfig())
    assert tracks.count == 4
    parked = {
        int(track)
        for truth, found in zip(true_ids(replace(toy, store=store), cached), tracks.by_view, strict=True)
        for true, track in zip(truth, found, strict=True)
        if true == 2
    }
    assert len(parked) == 1
