import numpy as np

from instdrive_core.scene.sky import Sky, find_cube_taps


def test_faces_show_along_their_axes():
    faces = np.zeros((6, 8, 8, 3), np.float32)
    faces[..., 0] = np.arange(6)[:, None, None]
    directions = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
    np.testing.assert_array_equal(Sky(faces).sample(7 * directions)[:, 0], np.arange(6))


def test_taps_are_convex_and_reproduce_a_ramp():
    directions = np.random.default_rng(0).normal(size=(500, 3))
    indices, weights = find_cube_taps(directions, 16)
    assert indices.min() >= 0
    assert indices.max() < 6 * 16 * 16
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=1e-5)
    assert weights.min() >= 0
    # On the +x face columns grow with y and rows with z: a face that holds its column shows (y / x + 1) / 2 there.
    faces = np.tile(((np.arange(16) + 0.5) / 16)[None, None, :, None], (6, 16, 1, 3)).astype(np.float32)
    inner = np.array([[1, y, 0.3] for y in np.linspace(-0.9, 0.9, 7)])
    np.testing.assert_allclose(Sky(faces).sample(inner)[:, 0], (inner[:, 1] + 1) / 2, atol=1e-5)


def test_an_image_of_directions_gives_an_image_of_colors():
    colors = Sky(np.full((6, 1, 1, 3), 0.25, np.float32)).sample(np.random.default_rng(1).normal(size=(4, 5, 3)))
    assert colors.shape == (4, 5, 3)
    np.testing.assert_allclose(colors, 0.25)
