"""What a deleted moving vehicle leaves, counted."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.passing_cars import AROUND, Tally, is_around, summarize


def test_a_smudge_is_dark_and_texture_is_neither_dark_nor_bright() -> None:
    inside = np.zeros((60, 80), bool)
    inside[10:50, 10:70] = True
    texture = np.where((np.indices(inside.shape).sum(axis=0) % 2)[..., None] > 0, 0.1, -0.1).repeat(3, axis=2)
    even, smudge = Tally(), Tally()
    even.add(texture.astype(np.float32), inside)
    smudge.add((texture - 0.2 * inside[..., None]).astype(np.float32), inside)
    assert even.summarize()["dark"] < 0.01
    assert even.summarize()["psnr"] == pytest.approx(20.0, abs=1e-3)
    assert smudge.summarize()["dark"] == pytest.approx(0.2, abs=0.01)
    assert smudge.summarize()["bright"] < 0.001
    figures = summarize([{"near": even}, {"near": smudge, "way": even}])
    assert figures["near_dark"] == pytest.approx(0.1, abs=0.01)
    assert figures["way_psnr"] == 20.0


def test_ground_around_a_box_is_told_from_above() -> None:
    pose = np.eye(4)
    pose[:3, 3] = [5.0, 0.0, 1.0]
    half = np.array([1.0, 2.0, 0.8])
    places = np.array([[5.0, 0, 0], [6.9, 0, 0], [5.0, 2.0 + AROUND + 0.1, 0], [5.9 + AROUND, 2.0 + AROUND, 0]])
    assert is_around(places, pose[None], half).tolist() == [True, True, False, False]
    shifted = pose.copy()
    shifted[1, 3] = 3.0
    assert is_around(places, np.stack([pose, shifted]), half).tolist() == [True, True, True, True]
