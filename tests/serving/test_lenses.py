"""Lenses that are no pinholes look where OpenCV and the f-theta polynomials say, and show the scene that lies there."""

import cv2
import numpy as np
import pytest
from parked_street import parked_street
from scipy import ndimage

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.rasterize.lens import LensRays, view_through_lens
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera
from instdrive_core.serving.client import build_picture_request
from instdrive_core.serving.lenses import trace_lens
from instdrive_core.serving.messages import find_enum_value, find_message_class

WIDTH, HEIGHT = 96, 64
MIDDLE = {"principal_point_x": 47.0, "principal_point_y": 33.0}
FOCAL = {"focal_length_x": 60.0, "focal_length_y": 62.0}
MATRIX = np.array([[60.0, 0, 47], [0, 62, 33], [0, 0, 1]])


def make_spec(**lens):
    return find_message_class("CameraSpec")(resolution_w=WIDTH, resolution_h=HEIGHT, **lens)


def list_pixels():
    return np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), axis=-1)


def test_distortion_is_that_of_opencv():
    values = {"radial_coeffs": [-0.2, 0.05, 0.01, 0.02, 0.01, 0.002]}
    values |= {"tangential_coeffs": [0.003, -0.002], "thin_prism_coeffs": [0.002, 0.001, -0.001, 0.002]}
    lens = find_message_class("OpenCVPinholeCameraParam")(**MIDDLE, **FOCAL, **values)
    rays = trace_lens(make_spec(opencv_pinhole_param=lens), (WIDTH, HEIGHT))
    k, p, s = values.values()
    coefficients = np.array([*k[:2], *p, *k[2:], *s])
    found, _ = cv2.projectPoints(
        rays.directions.reshape(-1, 1, 3).astype(np.float64), np.zeros(3), np.zeros(3), MATRIX, coefficients
    )
    assert rays.seen.all()
    np.testing.assert_allclose(found.reshape(HEIGHT, WIDTH, 2), list_pixels(), atol=0.02)


def test_fisheye_is_that_of_opencv():
    series = [0.05, -0.01, 0.002, -0.0005]
    lens = find_message_class("OpenCVFisheyeCameraParam")(**MIDDLE, **FOCAL, radial_coeffs=series)
    rays = trace_lens(make_spec(opencv_fisheye_param=lens), (WIDTH, HEIGHT))
    points = rays.directions.reshape(-1, 1, 3).astype(np.float64)
    found, _ = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, np.array(series))
    assert rays.seen.all()
    np.testing.assert_allclose(found.reshape(HEIGHT, WIDTH, 2), list_pixels(), atol=0.02)


@pytest.mark.parametrize("reference", ["forward", "backward"])
def test_ftheta_follows_its_polynomial(reference):
    """Pixels are at the forward polynomial of the angle, through [[c, d], [e, 1]]; the backward one is its inverse."""
    forward = [0.0, 30.0, 0.0, -1.0] if reference == "forward" else [0.0, 30.0]
    values = {"angle_to_pixeldist_poly": forward}
    if reference == "backward":
        values = {"pixeldist_to_angle_poly": [0.0, 1 / 30], "reference_poly": 1}
    lens = find_message_class("FthetaCameraParam")(**MIDDLE, **values, max_angle=1.6)
    lens.linear_cde.linear_c, lens.linear_cde.linear_d, lens.linear_cde.linear_e = 1.02, 0.01, -0.02
    rays = trace_lens(make_spec(ftheta_param=lens), (WIDTH, HEIGHT))
    x, y, z = rays.directions[rays.seen].astype(np.float64).T
    angle, across = np.arctan2(np.hypot(x, y), z), np.maximum(np.hypot(x, y), 1e-9)
    radius = np.polynomial.polynomial.polyval(angle, forward)
    offsets = np.stack([x, y], axis=1) * (radius / across)[:, None] @ np.array([[1.02, 0.01], [-0.02, 1]]).T
    np.testing.assert_allclose(offsets, list_pixels()[rays.seen] - np.array([47, 33]), atol=0.02)
    assert angle.max() <= 1.6 + 1e-6
    assert 0.8 < rays.seen.mean() < 1  # the corners lie beyond the largest angle


def test_a_smaller_picture_looks_the_same_ways():
    lens = find_message_class("OpenCVFisheyeCameraParam")(**MIDDLE, **FOCAL)
    spec = make_spec(opencv_fisheye_param=lens)
    whole, half = trace_lens(spec, (WIDTH, HEIGHT)), trace_lens(spec, (WIDTH // 2, HEIGHT // 2))
    between = whole.directions.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean(axis=(1, 3))
    assert np.abs(between - half.directions).max() < 1e-3


@pytest.fixture(scope="module")
def scene():
    return parked_street().scene


def test_a_narrow_lens_shows_what_a_pinhole_shows(scene):
    camera = scene.views[9].camera.resize(200, 120)
    directions = camera.compute_ray_directions() @ camera.world_from_camera[:3, :3]
    rays = LensRays(directions.astype(np.float32), np.ones((120, 200), bool))
    found = view_through_lens(scene, rays, camera.world_from_camera, 0.4)
    expected = view_scene(scene, camera, 0.4).color
    assert np.abs(found - expected).mean() < 0.02
    assert np.abs(expected - expected.mean(axis=(0, 1))).mean() > 0.1


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, 0.0), (45.0, 0.0), (-80.0, 0.0), (0.0, -45.0), (95.0, 0.0)])
def test_a_wide_lens_shows_all_around_what_pinholes_show_there(scene, yaw, pitch):
    pose = scene.views[9].camera.world_from_camera
    size, focal = 500, 120.0
    lens = find_message_class("OpenCVFisheyeCameraParam")(
        principal_point_x=250, principal_point_y=250, focal_length_x=focal, focal_length_y=focal
    )
    spec = find_message_class("CameraSpec")(opencv_fisheye_param=lens, resolution_w=size, resolution_h=size)
    around = view_through_lens(scene, trace_lens(spec, (size, size)), pose, 0.4)
    turn = np.eye(3)
    for angle, axis in ((yaw, 1), (pitch, 0)):
        quat = np.zeros(4)
        quat[0], quat[1 + axis] = np.cos(np.radians(angle) / 2), np.sin(np.radians(angle) / 2)
        turn = turn @ matrix_from_quaternion(quat)
    there = pose.copy()
    there[:3, :3] = pose[:3, :3] @ turn
    camera = Camera(focal, focal, 40.0, 30.0, 80, 60, there)
    expected = view_scene(scene, camera, 0.4).color
    x, y, z = np.moveaxis(camera.compute_ray_directions() @ pose[:3, :3], -1, 0)
    radius = focal * np.arctan2(np.hypot(x, y), z) / np.maximum(np.hypot(x, y), 1e-9)
    at = np.stack([250 + radius * y - 0.5, 250 + radius * x - 0.5])
    found = np.stack([ndimage.map_coordinates(around[:, :, k], at, order=1) for k in range(3)], axis=-1)
    assert np.abs(found - expected).mean() < 0.03


def test_the_server_draws_with_the_lens_that_the_request_names(client, service):
    view = service.stage.scene.views[9]
    request = build_picture_request(view.camera, view.time)
    lens = find_message_class("FthetaCameraParam")(
        principal_point_x=200, principal_point_y=120, angle_to_pixeldist_poly=[0, 150], max_angle=1.2
    )
    request.camera_intrinsics.ftheta_param.CopyFrom(lens)
    request.image_format = find_enum_value("ImageFormat", "RGB_UINT8_PLANAR")
    planes = np.frombuffer(client.call("render_rgb", request).image_bytes, np.uint8).reshape(3, 240, 400)
    rays = trace_lens(request.camera_intrinsics, (400, 240))
    expected = view_through_lens(service.stage.scene, rays, view.camera.world_from_camera, view.time)
    np.testing.assert_allclose(planes.transpose(1, 2, 0), np.clip(expected, 0, 1) * 255, atol=2)
    assert not planes[:, ~rays.seen].any()
