"""Overlaps of upright boxes against those counted by hand and by sampling."""

import math

import numpy as np
import pytest

from benchmarks.box_overlap import compute_box_iou

SIZE = np.array([2.0, 4.0, 1.5])


def place(x, y, z, yaw=0.0):
    pose = np.eye(4)
    pose[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    pose[:3, 3] = (x, y, z)
    return pose


@pytest.mark.parametrize(
    ("pose", "overlap"),
    [
        (place(0, 0, 0), 1.0),
        (place(0, 0, 0, math.pi), 1.0),
        (place(1, 0, 0), 1 / 3),
        (place(0, 2, 0), 1 / 3),
        (place(0, 0, 0.75), 1 / 3),
        (place(0, 0, 0, math.pi / 2), 4 / 12),
        (place(5, 0, 0), 0.0),
        (place(0, 0, 3), 0.0),
    ],
)
def test_overlaps_counted_by_hand(pose, overlap):
    assert compute_box_iou(place(0, 0, 0), SIZE, pose, SIZE) == pytest.approx(overlap, abs=1e-9)


def test_a_turned_box_overlaps_as_samples_say():
    first, second, other = place(0, 0, 0, 0.3), place(0.7, 0.9, 0.4, -0.5), np.array([1.5, 5.0, 2.0])
    points = np.random.default_rng(0).uniform(-4, 4, (400_000, 3))
    inside = [
        (np.abs((points - pose[:3, 3]) @ pose[:3, :3]) <= size / 2).all(axis=1)
        for pose, size in ((first, SIZE), (second, other))
    ]
    sampled = (inside[0] & inside[1]).sum() / (inside[0] | inside[1]).sum()
    assert compute_box_iou(first, SIZE, second, other) == pytest.approx(sampled, abs=0.02)
