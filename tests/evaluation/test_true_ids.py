"""The reference gives each Gaussian's true ID from labelled pixels, whatever IDs the scene carries."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.evaluation import true_ids
from instdrive_core.evaluation.true_ids import find_true_ids


def test_recovers_true_ids_of_background_and_actors(drive):
    truth = drive.scene.instance_ids
    blind = replace(drive.scene, instance_ids=np.zeros_like(truth), codewords=np.zeros_like(truth))
    found = find_true_ids(blind, drive.clip.training_frames, drive.truth.load)
    assert (found == truth).mean() > 0.93
    for label in np.unique(truth):
        assert (found[truth == label] == label).mean() > 0.75, label


def test_the_same_pixels_each_time_and_few_suffice(drive, monkeypatch):
    monkeypatch.setattr(true_ids, "PIXELS_PER_VIEW", 800)
    frames = drive.clip.training_frames
    once, again = (find_true_ids(drive.scene, frames, drive.truth.load) for _ in range(2))
    assert np.array_equal(once, again)
    assert (once == drive.scene.instance_ids).mean() > 0.85


def test_unseen_gaussians_follow_their_own_node(drive):
    # Only the actor's pixels are labelled: its Gaussians get its ID, the background's have no neighbour to follow.
    only_actor = {key: np.where(labels == 3, labels, 0) for key, labels in drive.truth.labels.items()}
    drive.truth.labels = only_actor
    actor_only = replace(drive.scene, gaussians=drive.scene.gaussians.copy())
    actor_only.gaussians.opacity_logits[actor_only.nodes == 0] = -20
    found = find_true_ids(actor_only, drive.clip.training_frames, drive.truth.load)
    assert (found[drive.scene.nodes == 1] == 3).all()
    assert (found[drive.scene.nodes == 0] == 0).all()


def test_no_views_no_ids(drive):
    assert not find_true_ids(drive.scene, [], drive.truth.load).any()


def test_progress_counts_views(drive):
    seen = []
    find_true_ids(
        drive.scene,
        drive.clip.training_frames[:3],
        drive.truth.load,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("seed", [0, 5])
def test_votes_follow_the_majority_of_weight(drive, seed):
    # A quarter of the labels is wrong; the truth still wins.
    rng = np.random.default_rng(seed)
    drive.truth.labels = {
        key: np.where((rng.random(labels.shape) < 0.25) & (labels > 0), 4, labels).astype(np.uint32)
        for key, labels in drive.truth.labels.items()
    }
    found = find_true_ids(drive.scene, drive.clip.training_frames, drive.truth.load)
    parked = drive.scene.instance_ids == 2
    assert (found[parked] == 2).mean() > 0.8
