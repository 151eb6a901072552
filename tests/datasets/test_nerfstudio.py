"""Folders with transforms.json: axes, intrinsics, missing photos, points, and what may not be in them."""

import json
import tracemalloc

import numpy as np
import pytest
from photo_models import COUNT, FOCAL, HEIGHT, WIDTH, photo_model, write_nerfstudio

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, UntrustedDataError


@pytest.fixture(scope="module")
def model():
    return photo_model()


@pytest.fixture
def root(model, tmp_path):
    return write_nerfstudio(tmp_path / "clip", model)


def load(root):
    return load_clip(str(root), ClipOptions())


def edit(root, change):
    content = json.loads((root / "transforms.json").read_text())
    change(content)
    (root / "transforms.json").write_text(json.dumps(content))


def test_poses_intrinsics_and_points_fit_the_photos(root, model):
    clip = load(root)
    assert [frame.key for frame in clip.frames] == [f"camera/{index:02d}" for index in range(COUNT)]
    for frame, camera, photo in zip(clip.frames, model.cameras, model.photos, strict=True):
        np.testing.assert_allclose(-frame.view.camera.world_from_camera[:3, 1], [0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(
            frame.view.camera.project(clip.points.points)[0], camera.project(model.points)[0], atol=1e-3
        )
        np.testing.assert_array_equal(frame.load_image(), photo)
    np.testing.assert_array_equal(clip.points.colors, model.colors)


def test_fields_that_are_not_read_are_noted(root):
    listing = json.loads((root / "transforms.json").read_text())
    listing["frames"][2]["mask_path"] = "masks/002.png"
    listing["val_filenames"] = []
    (root / "transforms.json").write_text(json.dumps(listing))
    assert "fields that are not read: val_filenames, mask_path" in load(root).notes


def test_missing_photos_are_left_out_and_counted(root, caplog):
    (root / "images" / "002.png").unlink()
    clip = load(root)
    assert [frame.view.index for frame in clip.frames] == [0, 1, 3, 4]
    assert "1 of 5 photos are missing" in caplog.text
    assert any("1 of 5 photos are missing" in note for note in clip.notes)
    for photo in (root / "images").iterdir():
        photo.unlink()
    with pytest.raises(DataError, match="none of the 5 photos"):
        load(root)


def test_without_points_it_says_what_training_starts_from(root):
    edit(root, lambda content: content.pop("ply_file_path"))
    clip = load(root)
    assert len(clip.points.points) == 0
    assert "no LiDAR and no points: starting from what photos agree on" in clip.notes[-1]


def test_sizes_come_from_photos_and_angles_from_the_first_nerfs(root):
    def to_first_nerfs(content):
        for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
            content.pop(key)
        content["camera_angle_x"] = 2 * np.arctan(WIDTH / 2 / FOCAL)
        for frame in content["frames"]:
            frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")

    edit(root, to_first_nerfs)
    camera = load(root).frames[0].view.camera
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2])


def test_two_angles_give_two_focal_lengths(root):
    def to_angles(content):
        del content["fl_x"], content["fl_y"]
        content |= {"camera_angle_x": 2 * np.arctan(WIDTH / 2 / 50), "camera_angle_y": 2 * np.arctan(HEIGHT / 2 / 40)}

    edit(root, to_angles)
    camera = load(root).frames[0].view.camera
    np.testing.assert_allclose([camera.fx, camera.fy], [50, 40])


def test_a_byte_order_mark_before_the_listing_is_no_damage(root):
    listing = root / "transforms.json"
    listing.write_bytes(b"\xef\xbb\xbf" + listing.read_bytes())
    assert len(load(root).frames) > 0


def test_a_photo_may_have_intrinsics_of_its_own(root):
    edit(root, lambda content: content["frames"][1].update(fl_x=60.0, k1=0.05))
    frames = load(root).frames
    assert [frame.view.camera.fx for frame in frames[:2]] == [FOCAL, 60.0]
    assert frames[0].valid is None
    assert frames[1].valid is not None


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda content: content.update(frames={}), "'frames' is a dict"),
        (lambda content: content.update(frames=[]), "lists no photo"),
        (lambda content: content.pop("fl_x"), r"'frames\[0\]\.fl_x' is missing"),
        (lambda content: content.update(fl_x="50"), "fl_x' is '50', expected a number"),
        (lambda content: content.update(w=10**6), "the size is 1000000×48"),
        (lambda content: content.update(w=64.5), "expected whole numbers"),
        (lambda content: content.update(k1=float("inf")), "k1' is inf"),
        (lambda content: content.update(camera_model="EQUIRECTANGULAR"), "'camera_model' is 'EQUIRECTANGULAR'"),
        (lambda content: content.update(camera_model=["OPENCV"]), "'camera_model' is"),
        (lambda content: content["frames"].append(3), r"'frames\[5\]\.file_path' is missing"),
        (lambda content: content["frames"][1].pop("transform_matrix"), r"frames\[1\]\.transform_matrix' is missing"),
        (lambda content: content["frames"][1].update(transform_matrix=[[1, 2]]), "no matrix"),
        (lambda content: content["frames"][1].update(transform_matrix=[[0] * 4] * 4), "no rotation and position"),
        (lambda content: content["frames"][1].update(file_path=7), "stands where a file's name should"),
        (lambda content: content.update(ply_file_path="no.ply"), r"'ply_file_path' names 'no\.ply'"),
    ],
)
def test_damaged_fields_are_named(root, change, problem):
    edit(root, change)
    with pytest.raises(DataError, match=problem):
        load(root)


@pytest.mark.parametrize("name", ["../../secret.png", "/etc/passwd", "images/../../x.png", "c:\\x.png"])
def test_paths_that_lead_out_are_refused(root, name):
    edit(root, lambda content: content["frames"][0].update(file_path=name))
    with pytest.raises(UntrustedDataError, match="leads out of"):
        load(root)
    edit(root, lambda content: content["frames"][0].update(file_path="images/000.png"))
    edit(root, lambda content: content.update(ply_file_path=name))
    with pytest.raises(UntrustedDataError, match="leads out of"):
        load(root)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_points_of_any_form_read_the_same_and_none_is_read_short(root, model, form):
    write_nerfstudio(root, model, form)
    file = root / "points.ply"
    np.testing.assert_array_equal(load(root).points.colors, model.colors)
    whole = file.read_bytes()
    for size in range(0, len(whole) - 8, len(whole) // 30):
        file.write_bytes(whole[:size])
        with pytest.raises(DataError, match=r"points\.ply"):
            load(root)
    for count in (b"vertex 99", b"vertex 999999999999", b"vertex -1", b"vertex many"):
        file.write_bytes(whole.replace(b"vertex 40", count))
        with pytest.raises(DataError, match=r"points\.ply"):
            load(root)


def test_a_point_without_an_end_takes_no_memory(root, model):
    write_nerfstudio(root, model, "ascii")
    file = root / "points.ply"
    file.write_bytes(file.read_bytes().replace(b"end_header\n", b"end_header\n" + b"10 " * 3_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(DataError, match=r"points\.ply: a line is longer than"):
            load(root)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_numbers_and_names_of_absurd_length_are_refused(root):
    listing = root / "transforms.json"
    whole = listing.read_text()
    for old, new in (('"fl_x": 50.0', f'"fl_x": {"9" * 400}'), ('"fl_x": 50.0', f'"fl_x": {"9" * 5000}')):
        listing.write_text(whole.replace(old, new))
        with pytest.raises(DataError, match=r"transforms\.json"):
            load(root)
    for name in ("a" * 5000, "\\ud800", "\\u0007"):
        listing.write_text(whole.replace("images/000.png", name))
        with pytest.raises(DataError, match=r"stands where a file's name should|no character"):
            load(root)


def test_missing_photos_without_a_size_keep_their_place_too(root):
    edit(root, lambda content: [content.pop(key) for key in ("w", "h")])
    (root / "images" / "000.png").unlink()
    assert [frame.view.index for frame in load(root).frames] == [1, 2, 3, 4]
