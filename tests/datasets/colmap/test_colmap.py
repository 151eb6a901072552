"""COLMAP folders: text and binary say the same, the world stands upright, damage is named."""

import struct

import numpy as np
import pytest
from photo_models import (
    COUNT,
    FOCAL,
    HEIGHT,
    WIDTH,
    photo_model,
    write_colmap_binary,
    write_colmap_text,
)
from PIL import Image

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError, UntrustedDataError


@pytest.fixture(scope="module")
def model():
    return photo_model()


@pytest.fixture(params=[write_colmap_binary, write_colmap_text], ids=["binary", "text"])
def root(request, model, tmp_path):
    return request.param(tmp_path / "clip", model)


@pytest.fixture
def binary(model, tmp_path):
    return write_colmap_binary(tmp_path / "clip", model)


@pytest.fixture
def text(model, tmp_path):
    return write_colmap_text(tmp_path / "clip", model)


def load(root, **options):
    return load_clip(str(root), ClipOptions(**options))


def edit(file, old, new):
    content = file.read_text()
    assert old in content
    file.write_text(content.replace(old, new, 1))


def test_both_forms_give_photos_poses_and_points_with_z_up(root, model):
    clip = load(root)
    assert [frame.key for frame in clip.frames] == [f"camera/{index:02d}" for index in range(COUNT)]
    assert [frame.view.held_out for frame in clip.frames] == [False, False, False, False, True]
    for frame, camera, photo in zip(clip.frames, model.cameras, model.photos, strict=True):
        # The cameras are level, so that all but a turn around z is known.
        np.testing.assert_allclose(-frame.view.camera.world_from_camera[:3, 1], [0, 0, 1], atol=1e-6)
        assert (frame.view.camera.fx, frame.view.camera.width) == (FOCAL, WIDTH)
        np.testing.assert_array_equal(frame.load_image(), photo)
        expected = camera.project(model.points)
        for found, value in zip(frame.view.camera.project(clip.points.points), expected, strict=True):
            np.testing.assert_allclose(found, value, atol=1e-3)
    np.testing.assert_array_equal(clip.points.colors, model.colors)
    np.testing.assert_allclose(clip.points.points[:, 2] + clip.origin[2], model.points[:, 2], atol=1e-5)
    assert (clip.sweeps, clip.tracks, clip.class_names) == ((), (), {})


def test_it_says_what_is_estimated_and_what_is_missing(root):
    notes = " | ".join(load(root).notes)
    assert "up is estimated" in notes
    assert "the scale is unknown: a unit of the file is taken for a metre" in notes
    assert "no LiDAR: starting from 40 sparse points" in notes


def test_pycolmap_reads_the_same(root, model):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    theirs = pycolmap.Reconstruction(str(root / "sparse" / "0"))
    clip = load(root)
    assert theirs.num_points3D() == len(clip.points.points)
    for image in theirs.images.values():
        pose = np.linalg.inv(np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]]))
        np.testing.assert_allclose(pose, model.listed_poses()[model.names.index(image.name)], atol=1e-9)


def test_missing_photos_keep_their_place(root, caplog):
    (root / "images" / "001.png").unlink()
    assert [frame.view.index for frame in load(root).frames] == [0, 2, 3, 4]
    assert "1 of 5 photos are missing" in caplog.text
    for photo in (root / "images").iterdir():
        photo.unlink()
    with pytest.raises(DataError, match=r"none of the 5 photos that it lists is there, e\.g\. .*000\.png"):
        load(root)


def test_options_choose_frames_scale_and_cameras(root):
    clip = load(root, first_frame=1, last_frame=2, scale=0.5)
    assert [frame.view.index for frame in clip.frames] == [1, 2]
    assert clip.frames[0].load_image().shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert clip.frames[0].view.camera.fx == FOCAL / 2
    for options in ({"first_frame": 9}, {"cameras": "roof"}, {"scale": 2.0}):
        with pytest.raises(OptionError):
            load(root, **options)


def test_folders_are_cameras_each_with_its_own_order(text):
    listing = text / "sparse" / "0" / "images.txt"
    content = listing.read_text()
    for number, name in enumerate(("left/a.png", "left/b.png", "right/a.png", "right/b.png")):
        (text / "images" / name).parent.mkdir(exist_ok=True)
        (text / "images" / f"{number:03d}.png").rename(text / "images" / name)
        content = content.replace(f" {number:03d}.png", f" {name}")
    listing.write_text(content)
    assert [frame.key for frame in load(text, cameras="left,right").frames] == [
        "left/00",
        "right/00",
        "left/01",
        "right/01",
    ]
    assert load(text, cameras="1").camera_names == ("camera",)


def test_a_model_in_an_implausible_unit_is_rescaled_and_says_so(text, model):
    folder = text / "sparse" / "0"
    for name, first, last in (("images.txt", 5, 8), ("points3D.txt", 1, 4)):
        lines = []
        for line in (folder / name).read_text().splitlines():
            words = line.split(" ")
            if not line.startswith("#") and len(words) > 7:
                words[first:last] = [repr(float(word) / 1000) for word in words[first:last]]
            lines.append(" ".join(words))
        (folder / name).write_text("\n".join(lines) + "\n")
    clip = load(text)
    assert any("is taken for" in note and "half of the points lie within 15 m" in note for note in clip.notes)
    pixels, depths = clip.frames[0].view.camera.project(clip.points.points)
    np.testing.assert_allclose(pixels, model.cameras[0].project(model.points)[0], atol=1e-2)
    assert 10 < np.median(depths) < 20


def test_distortion_is_removed_and_what_the_photo_lacks_is_invalid(text, model):
    cameras = text / "sparse" / "0" / "cameras.txt"
    edit(cameras, "7 PINHOLE", "7 OPENCV")
    cameras.write_text(cameras.read_text().rstrip("\n") + " 0.2 0.0 0.0 0.0\n")
    ramp = np.broadcast_to(np.arange(WIDTH, dtype=np.uint8)[None, :, None], (HEIGHT, WIDTH, 3))
    Image.fromarray(ramp.copy()).save(text / "images" / "000.png")
    frame = load(text).frames[0]
    x, y = (47.5 - WIDTH / 2) / FOCAL, (24.5 - HEIGHT / 2) / FOCAL
    shown_at = x * (1 + 0.2 * (x * x + y * y)) * FOCAL + WIDTH / 2 - 0.5
    assert abs(int(frame.load_image()[24, 47, 0]) - shown_at) <= 0.51
    assert frame.valid is not None
    assert frame.valid[HEIGHT // 2, WIDTH // 2]
    assert not frame.valid[0, 0]  # positive k: the corner of the pinhole lies outside of the photo


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("7 PINHOLE", "7 OPENCV_FISHEYE", "does not know"),
        ("PINHOLE 64", "PINHOLE 0", "the size is 0×48"),
        ("64 48 50.0", "64 48 -50.0", "first two positive"),
        ("64 48 50.0", "64 48 nan", "first two positive"),
        ("64 48 50.0", "64 48 many", "expected numbers"),
        ("cameras: 1", "cameras: 2", "promises 2 entries and holds 1"),
        ("cameras: 1", "cameras: " + "9" * 5000, "promises 9{18} entries and holds 1"),
        ("64 48 50.0", "64 48 50.0" + " 1" * 1_000_000, "expected numbers"),
        ("7 PINHOLE", "8 PINHOLE", "which the model does not hold"),
    ],
)
def test_damaged_cameras_are_named(text, old, new, problem):
    edit(text / "sparse" / "0" / "cameras.txt", old, new)
    with pytest.raises(DataError, match=problem):
        load(text)


def test_a_lens_that_is_not_known_is_refused_with_the_way_out(text):
    (text / "sparse" / "0" / "cameras.txt").write_text("7 FOV 64 48 50 50 32 24 0.9\n")
    with pytest.raises(DataError, match="image_undistorter"):
        load(text)


@pytest.mark.parametrize("name", ["../000.png", "/etc/passwd", "a\\..\\b.png"])
def test_names_that_lead_out_are_refused(text, name):
    edit(text / "sparse" / "0" / "images.txt", "000.png", name)
    with pytest.raises(UntrustedDataError, match="leads out of"):
        load(text)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_every_cut_and_every_lying_count_is_an_error(binary, name):
    file = binary / "sparse" / "0" / f"{name}.bin"
    whole = file.read_bytes()
    for size in [*range(0, len(whole), max(1, len(whole) // 60)), len(whole) - 1]:
        file.write_bytes(whole[:size])
        with pytest.raises(DataError, match=rf"{name}\.bin"):
            load(binary)
    for count in (0, 4, 2**40, 2**64 - 1):
        file.write_bytes(struct.pack("<Q", count) + whole[8:])
        with pytest.raises(DataError, match=rf"{name}\.bin"):
            load(binary)
    file.write_bytes(whole + b"\0")
    with pytest.raises(DataError, match="1 bytes follow"):
        load(binary)


def test_poses_and_points_that_are_no_numbers_are_refused(binary):
    for name, offset, problem in (("images", 12, "image 1 .*unit quaternion"), ("points3D", 16, "point 0 lies at")):
        file = binary / "sparse" / "0" / f"{name}.bin"
        whole = file.read_bytes()
        file.write_bytes(whole[:offset] + struct.pack("<d", float("nan")) + whole[offset + 8 :])
        with pytest.raises(DataError, match=problem):
            load(binary)
        file.write_bytes(whole)
