"""Unseen sky gets the colours of the sky around it; seen sky keeps its own."""

import numpy as np

from instdrive_core.scene.sky import Sky, compute_texel_directions
from instdrive_core.scene.sky_fill import SkyEvidence, fill_unseen_sky

RESOLUTION = 32


def measure_heights():
    directions = compute_texel_directions(RESOLUTION)
    return directions[..., 2] / np.linalg.norm(directions, axis=-1), directions


def gradient_with_noise():
    """A sky that is paler at the horizon; noise wherever no camera looked: behind, at the zenith, below."""
    heights, directions = measure_heights()
    blue = 0.5 + 0.4 * np.clip(heights, 0, 1)
    colors = np.stack([1 - blue, np.full_like(blue, 0.6), blue], axis=-1)
    seen = (directions[..., 1] > 0) & (heights > 0) & (heights < 0.5)
    noisy = np.where(seen[..., None], colors, np.random.default_rng(5).random(colors.shape))
    return Sky(noisy.astype(np.float32)), seen.astype(np.float32), colors


def test_unseen_sky_is_smooth_and_goes_on_along_the_horizon():
    sky, evidence, colors = gradient_with_noise()
    filled = fill_unseen_sky(sky, SkyEvidence(evidence)).faces
    heights, directions = measure_heights()
    behind = (directions[..., 1] < -0.3) & (heights > 0.05) & (heights < 0.4)
    assert np.abs(filled - colors)[behind].mean() < 0.05
    assert np.abs(sky.faces - colors)[behind].mean() > 0.2
    for face in filled[[1, 3, 4, 5]]:
        assert np.abs(np.diff(face, axis=0)).max() < 0.15
        assert np.abs(np.diff(face, axis=1)).max() < 0.15


def test_seen_sky_keeps_its_bits_and_what_was_seen_through_a_hole_in_the_road_is_not_copied():
    sky, evidence, _ = gradient_with_noise()
    filled = fill_unseen_sky(sky, SkyEvidence(evidence)).faces
    np.testing.assert_array_equal(filled[evidence >= 1], sky.faces[evidence >= 1])
    heights, _ = measure_heights()
    road = (heights < -0.5) & (np.random.default_rng(2).random(heights.shape) < 0.3)
    faces = np.where(road[..., None], np.float32([1, 0, 0]), sky.faces)
    with_hole = fill_unseen_sky(Sky(faces), SkyEvidence(np.where(road, np.float32(1), evidence))).faces
    np.testing.assert_allclose(with_hole[~road], filled[~road], atol=1e-6)


def test_a_sky_that_nothing_is_known_of_stays():
    sky, evidence, _ = gradient_with_noise()
    assert fill_unseen_sky(sky, SkyEvidence(np.zeros_like(evidence))) is sky


def test_below_the_horizon_the_ground_shows_where_no_photo_saw_any():
    sky, evidence, _ = gradient_with_noise()
    heights, _ = measure_heights()
    seen_below = (heights < -0.5) & (heights > -0.6)
    evidence = np.where(seen_below, np.float32(1), evidence)
    ground = np.array([0.2, 0.3, 0.1])
    filled = fill_unseen_sky(sky, SkyEvidence(evidence, ground)).faces
    steep = (heights < -0.2) & ~seen_below
    np.testing.assert_allclose(filled[steep], np.broadcast_to(ground, filled[steep].shape), atol=1e-5)
    np.testing.assert_array_equal(filled[seen_below], sky.faces[seen_below])
    plain = fill_unseen_sky(sky, SkyEvidence(evidence)).faces
    np.testing.assert_array_equal(filled[heights > 0.1], plain[heights > 0.1])
