"""Photos of fisheye lenses become those that a pinhole would have taken: painted directions are the truth.

Which direction a fisheye's pixel sees is found with OpenCV or by bisection, never with the code under test.
"""

import json

import cv2
import numpy as np
import pytest
from photo_models import photo_model, write_colmap_text, write_nerfstudio
from PIL import Image
from small_clip import WHOLE, write_layout

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.distortion import find_covered_pixels, undistort
from instdrive_core.datasets.fisheye import Fisheye, choose_pinhole
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.scene.camera import Camera

WIDTH, HEIGHT = 240, 180
LENS = Camera(80.0, 82.0, 123.0, 88.0, WIDTH, HEIGHT, np.eye(4))
KB4 = (0.03, -0.01, 0.004, -0.001)


def paint(rays):
    """A colour for each direction, smooth and different everywhere in front."""
    x, y, z = np.moveaxis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), -1, 0)
    return np.stack([127 + 120 * np.sin(5 * x), 127 + 120 * np.sin(5 * y + 1), 127 + 100 * z], axis=-1)


def pixels():
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    return np.stack([columns, rows], axis=-1)


def unproject_with_opencv(coefficients):
    matrix = np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1.0]])
    flat = cv2.fisheye.undistortPoints(pixels().reshape(-1, 1, 2), matrix, np.array(coefficients))
    return np.concatenate([flat, np.ones((len(flat), 1, 1))], axis=-1).reshape(HEIGHT, WIDTH, 3)


def unproject_by_bisection(project):
    """Directions of all pixels of a lens without shifts; `project` maps angles to radii."""
    places = (pixels() - (LENS.cx, LENS.cy)) / (LENS.fx, LENS.fy)
    radius = np.linalg.norm(places, axis=-1)
    low, high = np.zeros_like(radius), np.full_like(radius, 1.5)
    for _ in range(50):
        middle = (low + high) / 2
        below = project(middle) < radius
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    across = places / np.maximum(radius, 1e-12)[..., None] * np.sin(low)[..., None]
    return np.concatenate([across, np.cos(low)[..., None]], axis=-1)


def project_mirror(angle, xi=0.9, k1=0.05):
    radius = np.sin(angle) / (np.cos(angle) + xi)
    return radius * (1 + k1 * radius**2)


CASES = {
    "Kannala-Brandt": (lambda: unproject_with_opencv(KB4), Fisheye(KB4)),
    "mirror": (lambda: unproject_by_bisection(project_mirror), Fisheye((0.05,), mirror=0.9)),
    "COLMAP's radial": (lambda: unproject_by_bisection(lambda angle: angle * (1 + 0.02 * angle**2)), Fisheye((0.02,))),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_photo_becomes_that_of_the_pinhole(name, scale):
    unproject, fisheye = CASES[name]
    photo = np.round(paint(unproject())).astype(np.uint8)
    pinhole, chosen = choose_pinhole(LENS, fisheye, 70.0)
    camera = pinhole.scale(scale)
    loaded = np.asarray(Image.fromarray(photo).resize((camera.width, camera.height), Image.Resampling.BOX))
    rectified, covered = undistort(loaded, camera, chosen), find_covered_pixels(camera, chosen)
    error = np.abs(rectified - paint(camera.compute_ray_directions()))[covered]
    assert covered.mean() > 0.9
    assert error.max() < 4 / scale
    assert error.mean() < 0.5 / scale


def test_the_thin_prism_is_colmaps_formula():
    x, y = 0.4, -0.7
    radius = np.hypot(x, y)
    u, v = (value * np.arctan(radius) / radius for value in (x, y))
    r2 = u * u + v * v
    factor = 1 + 0.01 * r2 + 0.02 * r2**2 + 0.03 * r2**3 + 0.04 * r2**4
    expected = (
        u * factor + 2 * 0.001 * u * v + 0.002 * (r2 + 2 * u * u) + 0.005 * r2,
        v * factor + 2 * 0.002 * u * v + 0.001 * (r2 + 2 * v * v) + 0.006 * r2,
    )
    lens = Fisheye((0.01, 0.02, 0.03, 0.04), (0.001, 0.002), (0.005, 0.006))
    np.testing.assert_allclose(lens.distort(np.array([x]), np.array([y])), np.array(expected)[:, None], rtol=1e-12)


@pytest.mark.parametrize("field", [60.0, 100.0])
def test_the_field_that_is_asked_for_is_kept(field):
    pinhole, _ = choose_pinhole(LENS, Fisheye(KB4), field)
    assert np.degrees(2 * np.arctan(pinhole.width / 2 / pinhole.fx)) == pytest.approx(field)
    assert (pinhole.width, pinhole.height, pinhole.fx) == (WIDTH, HEIGHT, pinhole.fy)


def test_a_lens_that_sees_less_keeps_what_it_sees():
    narrow = Camera(300.0, 300.0, 120.0, 90.0, WIDTH, HEIGHT, np.eye(4))
    pinhole, chosen = choose_pinhole(narrow, Fisheye(), 100.0)
    half = np.arctan(pinhole.width / 2 / pinhole.fx)
    assert half == pytest.approx(120 / 300, abs=np.radians(0.6))
    assert find_covered_pixels(pinhole, chosen).mean() > 0.98


LINES = (
    "OPENCV_FISHEYE 64 48 30 31 32 24 0.01 0.02 0 0",
    "SIMPLE_FISHEYE 64 48 30 32 24",
    "FISHEYE 64 48 30 31 32 24",
    "SIMPLE_RADIAL_FISHEYE 64 48 30 32 24 0.01",
    "RADIAL_FISHEYE 64 48 30 32 24 0.01 0.02",
    "THIN_PRISM_FISHEYE 64 48 30 31 32 24 0.01 0.02 0 0 0 0 0.001 0",
)


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.split()[0])
def test_colmaps_fisheyes_open_as_pinholes(tmp_path, line):
    root = write_colmap_text(tmp_path / "clip", photo_model())
    (root / "sparse" / "0" / "cameras.txt").write_text(f"7 {line}\n")
    for field in (60.0, 80.0):
        frame = load_clip(str(root), ClipOptions(scale=1.0, fisheye_field=field)).frames[0]
        camera = frame.view.camera
        assert np.degrees(2 * np.arctan(camera.width / 2 / camera.fx)) == pytest.approx(field)
        assert frame.valid is not None
        assert frame.load_image().shape == (48, 64, 3)


def test_nerfstudios_fisheye_is_opencvs(tmp_path):
    root = write_nerfstudio(tmp_path / "clip", photo_model())
    file = root / "transforms.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"camera_model": "OPENCV_FISHEYE", "k1": 0.02}))
    plain = load_clip(str(root), ClipOptions(scale=1.0, fisheye_field=50.0)).frames[0]
    camera = plain.view.camera
    assert np.degrees(2 * np.arctan(camera.width / 2 / camera.fx)) == pytest.approx(50)


@pytest.mark.parametrize("field", [0.0, 175.0, float("nan")])
def test_a_field_that_no_pinhole_has_is_refused(tmp_path, field):
    root = write_colmap_text(tmp_path / "clip", photo_model())
    with pytest.raises(OptionError, match="give degrees from 10 to 160"):
        load_clip(str(root), ClipOptions(fisheye_field=field))


MEI = """%YAML:1.0
---
model_type: MEI
mirror_parameters:
   xi: 0.9
distortion_parameters:
   k1: 0.05
   k2: 0.0
   p1: 0.0
   p2: 0.0
projection_parameters:
   gamma1: 80.0
   gamma2: 82.0
   u0: 123.0
   v0: 88.0
"""


@pytest.fixture
def drive(tmp_path):
    """A drive of KITTI-360 with a fisheye camera that looks to the left."""
    root = write_layout("KITTI-360", tmp_path / "clip")
    calibration = root.parents[1] / "calibration"
    (calibration / "image_02.yaml").write_text(MEI)
    between = calibration / "calib_cam_to_pose.txt"
    between.write_text(between.read_text() + between.read_text().replace("image_00", "image_02"))
    photo = Image.fromarray(np.round(paint(unproject_by_bisection(project_mirror))).astype(np.uint8))
    folder = root / "image_02" / "data_rgb"
    folder.mkdir(parents=True)
    for step in range(3):
        photo.save(folder / f"{step:010d}.png")
    return root


def test_kitti360s_fisheye_cameras_are_read(drive):
    clip = load_clip(str(drive), WHOLE)
    assert clip.camera_names == ("image_00", "image_02")
    front, side = clip.frames[:2]
    np.testing.assert_allclose(side.view.camera.position, front.view.camera.position)
    camera = side.view.camera
    local = camera.compute_ray_directions() @ camera.world_from_camera[:3, :3]
    error = np.abs(side.load_image() - paint(local))[side.valid]
    assert error.mean() < 0.5


def test_a_damaged_mirror_is_named(drive):
    file = drive.parents[1] / "calibration" / "image_02.yaml"
    for old, new, problem in (("xi: 0.9", "xi: -4", "xi is -4"), ("gamma1: 80.0", "", "'gamma1' is missing")):
        file.write_text(MEI.replace(old, new))
        with pytest.raises(DataError, match=problem):
            load_clip(str(drive), WHOLE)
