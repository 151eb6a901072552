import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.scene.camera import Camera, look_at

CAMERA = Camera(50.0, 55.0, 31.0, 25.5, 64, 48, look_at(np.array([4.0, -3.0, 2.0]), np.array([0.5, 0.2, 0.1])))


def test_the_target_lies_ahead_and_up_is_up():
    centered = Camera(50.0, 50.0, 32.0, 24.0, 64, 48, CAMERA.world_from_camera)
    pixels, depths = centered.project(np.array([[0.5, 0.2, 0.1], [0.5, 0.2, 1.1]]))
    np.testing.assert_allclose(pixels[0], [32, 24], atol=1e-9)
    assert pixels[1, 1] < pixels[0, 1]
    np.testing.assert_allclose(depths[0], np.linalg.norm([3.5, -3.2, 1.9]))


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(1, 50))
def test_points_on_a_pixels_ray_project_to_its_centre(x, y, distance):
    column, row = round(32 + 10 * x), round(24 + 7 * y)
    point = CAMERA.position + distance * CAMERA.compute_ray_directions()[row, column]
    pixels, depths = CAMERA.project(point[None])
    np.testing.assert_allclose(pixels[0], [column + 0.5, row + 0.5], atol=1e-6)
    assert depths[0] > 0


def test_inverse_and_resizing():
    np.testing.assert_allclose(CAMERA.camera_from_world @ CAMERA.world_from_camera, np.eye(4), atol=1e-12)
    point = np.array([[0.3, 0.1, 0.4]])
    half = CAMERA.scale(0.5)
    assert (half.width, half.height) == (32, 24)
    np.testing.assert_allclose(half.project(point)[0], CAMERA.project(point)[0] / 2)
    assert (CAMERA.scale(1e-6).width, CAMERA.scale(1e-6).height) == (1, 1)


def test_looking_straight_down_is_a_rotation():
    pose = look_at(np.array([0, 0, 5.0]), np.zeros(3))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(pose[:3, :3]), 1)
    np.testing.assert_allclose(pose[:3, 2], [0, 0, -1])
