"""PandaSet's layout as a clip: a small one made here, and the real one."""

import io
import json
import logging
import pickle
import tracemalloc

import numpy as np
import pytest
from PIL import Image
from small_clip import (
    HEIGHT,
    LIDAR_STEPS,
    MOVING,
    PARKED,
    START,
    STEPS,
    TWIN,
    WIDTH,
    cuboids_at,
    moving_position,
    offset,
    photo_at,
    sweep_at,
    write_json,
    write_small_clip,
    write_table,
)

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError, UntrustedDataError
from instdrive_core.scene.track import find_points_inside

ALL = "front_camera,back_camera"


@pytest.fixture
def root(tmp_path):
    return write_small_clip(tmp_path / "clip")


def load(root, **options):
    return load_clip(str(root), ClipOptions(**{"cameras": ALL, **options}))


def npy_of(shape, content, kind="<u4"):
    """A .npy file whose header may lie."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
    return file.getvalue() + content


def edit_json(path, change):
    content = json.loads(path.read_text())
    change(content)
    write_json(path, content)


def test_frames_are_the_photos_there_are_ordered_by_step(root):
    clip = load(root)
    assert clip.camera_names == ("front_camera", "back_camera")
    assert [frame.key for frame in clip.frames[:3]] == ["front_camera/02", "back_camera/02", "front_camera/03"]
    assert len(clip.frames) == 2 * len(STEPS)
    assert {frame.view.index for frame in clip.held_out_frames} == {4}
    assert {frame.view.index for frame in clip.training_frames} == set(STEPS) - {4}
    assert clip.frames[0].view.time == pytest.approx(0.2, abs=1e-6), "since the first listed step, not the first photo"
    assert clip.name == "clip"


def test_cameras_look_where_their_heading_says(root):
    clip = load(root)
    np.testing.assert_array_equal(clip.origin, np.round(START + offset(0, np.mean(STEPS), 0)))
    front, back = (frame.view.camera for frame in clip.frames[:2])
    ahead = START + offset(0, 2, 0) + offset(1.0, 10.0, 2.0) - clip.origin
    pixels, depths = front.project(ahead[None])
    np.testing.assert_allclose(pixels[0], [31 + 40 * 1.0 / 10, 17 - 42 * 2.0 / 10])
    assert depths[0] == pytest.approx(10)
    assert back.project(ahead[None])[1][0] == pytest.approx(-10)


def test_intrinsics_and_photos_follow_the_scale(root):
    frame = load(root, scale=0.5).frames[0]
    camera = frame.view.camera
    assert (camera.width, camera.height) == (WIDTH // 2, HEIGHT // 2)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (20.0, 21.0, 15.5, 8.5)
    image = frame.load_image()
    assert image.dtype == np.uint8
    assert image.shape == (HEIGHT // 2, WIDTH // 2, 3)
    difference = image.astype(int) - photo_at(2)[::2, ::2]
    assert np.abs(difference).mean() < 6, "each pixel is the mean of its block, up to what JPEG loses"
    assert load(root).frames[0].load_image().shape == (HEIGHT, WIDTH, 3), "small photos stay as they are by default"


def test_the_recording_car_is_invalid_in_the_back_camera(root):
    front, back = load(root, scale=0.5).frames[:2]
    assert front.valid is None
    invalid_rows = int(np.ceil(18 * 256 / 1080))
    assert back.valid.shape == (18, 32)
    assert not back.valid[-invalid_rows:].any()
    assert back.valid[:-invalid_rows].all()


def test_sweeps_are_in_float32_around_the_origin(root):
    clip = load(root)
    assert [sweep.index for sweep in clip.sweeps] == list(LIDAR_STEPS)
    assert [sweep.index for sweep in clip.training_sweeps] == [2, 6]
    sweep = clip.sweeps[0].load()
    expected, classes, sensors = sweep_at(2)
    assert sweep.points.dtype == np.float32
    np.testing.assert_allclose(sweep.points, expected - clip.origin, atol=1e-5)
    np.testing.assert_array_equal(sweep.classes, classes)
    np.testing.assert_array_equal(sweep.sensor, sensors)
    np.testing.assert_allclose(sweep.intensity, 51 / 255)
    assert sweep.instance_labels is None
    assert clip.class_names[7] == "Road"


def test_plain_pickles_read_the_same(root, tmp_path):
    plain = load(write_small_clip(tmp_path / "plain", ".pkl"))
    packed = load(root)
    for one, other in zip(plain.sweeps, packed.sweeps, strict=True):
        np.testing.assert_array_equal(one.load().points, other.load().points)
    assert [track.id for track in plain.tracks] == [track.id for track in packed.tracks]


def test_siblings_are_one_track_where_the_spinning_lidar_met_it(root):
    clip = load(root)
    tracks = {track.id: track for track in clip.tracks}
    assert set(tracks) == {PARKED, MOVING}
    assert tracks[MOVING].moving
    assert not tracks[PARKED].moving
    np.testing.assert_allclose(
        tracks[MOVING].world_from_box[:, :3, 3], [moving_position(step) - clip.origin for step in STEPS]
    )
    np.testing.assert_allclose(tracks[MOVING].times, [0.1 * step for step in STEPS], atol=1e-6)
    np.testing.assert_allclose(tracks[PARKED].dimensions, [2, 4.5, 1.5])
    length_axis = tracks[PARKED].world_from_box[0, :3, 1]
    np.testing.assert_allclose(length_axis, [-1, 0, 0], atol=1e-12), "yaw turns the length axis from +y towards -x"


def test_a_sibling_fills_in_where_its_twin_is_missing(root):
    file = root / "annotations" / "cuboids" / "03.pkl.gz"
    table = {name: np.delete(column, 1) for name, column in cuboids_at(3).items()}
    write_table(file, table)
    track = next(track for track in load(root).tracks if track.id == MOVING)
    assert TWIN not in {track.id for track in load(root).tracks}
    assert len(track.times) == len(STEPS)
    shift = track.world_from_box[1, :3, 3] + load(root).origin - moving_position(3)
    np.testing.assert_allclose(shift, [0, 0.6, 0], atol=1e-6)


def test_moving_is_judged_over_the_loaded_frames(root):
    clip = load(root, first_frame=3, last_frame=3)
    assert {frame.view.index for frame in clip.frames} == {3}
    assert not any(track.moving for track in clip.tracks)
    assert clip.sweeps == ()


def test_missing_files_are_left_out(root):
    (root / "camera" / "front_camera" / "03.jpg").unlink()
    (root / "lidar" / "02.pkl.gz").unlink()
    (root / "annotations" / "cuboids" / "06.pkl.gz").unlink()
    clip = load(root)
    assert "front_camera/03" not in {frame.key for frame in clip.frames}
    assert "back_camera/03" in {frame.key for frame in clip.frames}
    assert [sweep.index for sweep in clip.sweeps] == [4, 6]
    assert all(len(track.times) == len(STEPS) - 1 for track in clip.tracks)


def test_classes_of_another_length_are_left_out_and_logged(root, caplog):
    write_table(root / "annotations" / "semseg" / "02.pkl.gz", {"class": np.array([7, 8])})
    with caplog.at_level(logging.WARNING):
        assert load(root).sweeps[0].load().classes is None
    assert "2 classes for 6 points" in caplog.text


def test_exact_labels_of_points_are_read(root):
    labels = root / "labels" / "lidar"
    labels.mkdir(parents=True)
    np.save(labels / "02.npy", np.arange(6, dtype=np.uint32))
    np.save(labels / "04.npy", np.arange(5, dtype=np.uint32))
    sweeps = load(root).sweeps
    assert sweeps[0].load().instance_labels.tolist() == [0, 1, 2, 3, 4, 5]
    with pytest.raises(DataError, match=r"04\.npy.*shape \(5,\) for 6 points"):
        sweeps[1].load()
    assert sweeps[2].load().instance_labels is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        # Both would have taken as much memory as they promise before they were found to be lies.
        (b"\x93NUMPY\x02\x00" + (700 << 20).to_bytes(4, "little") + b"{'descr': '<u4'}", "EOF|expected"),
        (npy_of((1 << 40,), b"\0" * 24), "24 bytes are there"),
        (npy_of((6,), b"\0" * 20), "20 bytes are there"),
        (npy_of((6,), b"\0" * 100_000), "larger than 6 values"),
        (npy_of((6,), b"\0" * 24, "|O"), "not numbers"),
    ],
)
def test_lying_label_arrays_are_refused_before_memory_is_taken(root, content, message):
    labels = root / "labels" / "lidar"
    labels.mkdir(parents=True)
    (labels / "02.npy").write_bytes(content)
    sweep = load(root).sweeps[0]
    tracemalloc.start()
    try:
        with pytest.raises(DataError, match=message):
            sweep.load()
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()


def test_camera_sets_and_names(root, caplog):
    assert load(root, cameras="1").camera_names == ("front_camera",)
    with caplog.at_level(logging.WARNING):
        assert load(root, cameras="6").camera_names == ("front_camera", "back_camera")
    assert "no folder for front_left_camera" in caplog.text
    assert load(root, cameras="back_camera").camera_names == ("back_camera",)
    with pytest.raises(OptionError, match="no camera 'rear'; choose 1, 3, 6 or names of back_camera, front_camera"):
        load(root, cameras="front_camera,rear")


@pytest.mark.parametrize("scale", [0, -1, 1.5, float("nan")])
def test_unusable_scales_are_refused(root, scale):
    with pytest.raises(OptionError, match="scale is"):
        load(root, scale=scale)


def test_an_empty_frame_range_is_refused(root):
    with pytest.raises(OptionError, match="no photo lies in the chosen frames; there are 2–6"):
        load(root, first_frame=7)


def test_a_folder_that_is_no_clip_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"is no driving clip of a known layout.*PandaSet: folders 'camera'"):
        load(tmp_path)
    (tmp_path / "camera").mkdir()
    with pytest.raises(DataError, match="no timestamps"):
        load(tmp_path)
    write_json(tmp_path / "meta" / "timestamps.json", [1.0, 2.0])
    with pytest.raises(DataError, match="holds no camera of the set 6"):
        load(tmp_path, cameras="6")


FRONT = "camera/front_camera"


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        (f"{FRONT}/intrinsics.json", "{", "no readable JSON"),
        (f"{FRONT}/intrinsics.json", '{"fx": 1}', "the field 'fy' is missing"),
        (f"{FRONT}/intrinsics.json", '{"fx": 0, "fy": 1, "cx": 1, "cy": 1}', "focal lengths"),
        (f"{FRONT}/intrinsics.json", '{"fx": "wide", "fy": 1, "cx": 1, "cy": 1}', "'fx' is 'wide'"),
        (f"{FRONT}/poses.json", "{}", "expected a list"),
        (f"{FRONT}/poses.json", '[{"position": {}}]', "lists 1 poses, yet there is a photo 06.jpg"),
        ("meta/timestamps.json", "[1, 1]", "timestamps do not rise"),
        ("meta/timestamps.json", "[1, 2, 3]", "photo of step 6, yet 3 timestamps"),
        ("meta/timestamps.json", '[1, "x"]', r"'\[1\]' is 'x'"),
        (f"{FRONT}/02.jpg", "no photo", "no readable photo"),
        ("annotations/semseg/classes.json", '{"a": "b"}', "from class numbers to names"),
        ("annotations/semseg/classes.json", '{"%s": "b"}' % ("9" * 5000), "'9{40}' is no whole number"),
        ("annotations/semseg/classes.json", r'{"7": "\udc80"}', "half a character"),
    ],
)
def test_damaged_files_are_named(root, file, content, message):
    (root / file).write_text(content)
    with pytest.raises(DataError, match=message):
        load(root)


def test_a_damaged_pose_is_named_with_its_place(root):
    edit_json(root / FRONT / "poses.json", lambda poses: poses[5]["heading"].pop("w"))
    with pytest.raises(DataError, match=r"poses\.json: the field '\[5\]\.heading\.w' is missing"):
        load(root)
    for value in (0, 1e200):
        edit_json(
            root / FRONT / "poses.json",
            lambda poses, value=value: poses[5].update(heading=dict.fromkeys("wxyz", value)),
        )
        with pytest.raises(DataError, match=r"\[5\]\.heading is no rotation"):
            load(root)


def test_a_photo_of_another_size_is_refused_when_read(root):
    Image.fromarray(photo_at(0)[:10]).save(root / FRONT / "05.jpg")
    frame = next(frame for frame in load(root).frames if frame.key == "front_camera/05")
    with pytest.raises(DataError, match=r"05\.jpg: is 64×10, the camera's photos 64×36"):
        frame.load_image()


def test_a_camera_without_photos_is_left_out_and_said(root, caplog):
    for photo in (root / "camera" / "back_camera").glob("*.jpg"):
        photo.unlink()
    with caplog.at_level(logging.WARNING):
        clip = load(root)
    assert clip.camera_names == ("front_camera",)
    assert {frame.view.name for frame in clip.frames} == {"front_camera"}
    note = "back_camera has no photo of the chosen frames; going on without it"
    assert note in caplog.text
    assert note in clip.notes


@pytest.mark.parametrize("name", ["05.jpg", "05.png"])
@pytest.mark.parametrize("keep", [0, 100, 0.7])
def test_half_a_photo_is_named_when_read(root, name, keep):
    photo = root / FRONT / name
    Image.fromarray(photo_at(5)).save(photo)
    if name != "05.jpg":
        (root / FRONT / "05.jpg").unlink()
    content = photo.read_bytes()
    photo.write_bytes(content[: keep if keep in (0, 100) else int(keep * len(content))])
    frame = next(frame for frame in load(root).frames if frame.key == "front_camera/05")
    with pytest.raises(DataError, match=rf"{name}: is no readable photo"):
        frame.load_image()


@pytest.mark.parametrize(
    ("file", "columns", "message"),
    [
        ("lidar/02.pkl.gz", {"x": [0.0]}, "the column 'y' is missing, found x"),
        ("lidar/02.pkl.gz", {"x": ["a"]}, "the column 'x' holds no numbers"),
        ("lidar/02.pkl.gz", {"x": [np.nan]}, "not finite"),
        ("lidar/02.pkl.gz", {"d": [0, 0, 256, 0, 0, 0]}, "'d' holds 256 in row 2, not a whole number"),
        ("lidar/02.pkl.gz", {"d": [0, 0, 0, None, 0, 0]}, "'d' holds values that are not finite"),
        ("annotations/semseg/02.pkl.gz", {"class": [7, 7, 7, 7, 7, -1.0]}, "'class' holds -1 in row 5"),
    ],
)
def test_damaged_sweeps_are_named_when_read(root, file, columns, message):
    x, y, z, intensity = (list(range(6)) for _ in range(4))
    write_table(root / file, {"x": x, "y": y, "z": z, "i": intensity} | columns if "d" in columns else columns)
    sweep = load(root).sweeps[0]
    with pytest.raises(DataError, match=message):
        sweep.load()


def test_damaged_cuboids_are_named(root):
    file = root / "annotations" / "cuboids" / "03.pkl.gz"
    table = cuboids_at(3)
    table["dimensions.z"] = np.array([1.5, 0.0, 1.5])
    write_table(file, table)
    with pytest.raises(DataError, match=r"03\.pkl\.gz: row 1 has no usable position, size or yaw"):
        load(root)
    for column, wrong in (
        ("cuboids.sensor_id", [-1, None, 0]),
        ("cuboids.sensor_id", [0, np.nan, 1]),
        ("label", ["a\ud800"] * 3),
    ):
        write_table(file, cuboids_at(3) | {column: np.array(wrong)})
        with pytest.raises(DataError, match=r"03\.pkl\.gz: a cuboid's uuid, label, sensor or sibling"):
            load(root)
    del table["uuid"]
    write_table(file, table)
    with pytest.raises(DataError, match="the column 'uuid' is missing"):
        load(root)


def test_hostile_cuboids_stop_the_loader(root):
    (root / "annotations" / "cuboids" / "03.pkl").write_bytes(pickle.dumps(print))
    (root / "annotations" / "cuboids" / "03.pkl.gz").unlink()
    with pytest.raises(UntrustedDataError, match=r"builtins\.print"):
        load(root)


def test_the_real_clip(pandaset_clip):
    clip = load_clip(str(pandaset_clip), ClipOptions())
    assert len(clip.frames) == 180
    assert len(clip.training_frames) == 162
    assert [sweep.index for sweep in clip.sweeps] == list(range(30, 56))
    assert {sweep.index for sweep in clip.sweeps} - {sweep.index for sweep in clip.training_sweeps} == {34, 44, 54}
    assert clip.frames[0].view.camera.width == 480
    assert clip.frames[0].view.time == pytest.approx(3.0, abs=0.01)
    assert sum(track.moving for track in clip.tracks) >= 20
    assert len({track.id for track in clip.tracks}) == len(clip.tracks)


def test_boxes_of_the_real_clip_hold_the_points_of_their_class(pandaset_clip):
    """Cuboids, points, origin and yaw fit together: most car points lie in a box, hardly any wall does."""
    clip = load_clip(str(pandaset_clip), ClipOptions(cameras="1", first_frame=40, last_frame=42))
    sweep = clip.sweeps[0].load()
    inside = np.zeros(len(sweep.points), bool)
    for track in clip.tracks:
        if track.label == "Car":
            inside |= find_points_inside(
                sweep.points, track.interpolate_pose(clip.sweeps[0].time), track.dimensions, 0.1
            )
    assert inside[(sweep.classes == 13) & (sweep.sensor == 0)].mean() > 0.8
    assert inside[sweep.classes == 41].mean() < 0.01


def test_points_of_the_real_clip_fall_on_what_the_photo_shows(pandaset_clip):
    """Vegetation is darker and greener than walls: poses, axes and intrinsics of a side camera fit the LiDAR."""
    clip = load_clip(str(pandaset_clip), ClipOptions(cameras="front_camera", first_frame=40, last_frame=40))
    sweep, frame = clip.sweeps[0].load(), clip.frames[0]
    image = frame.load_image().astype(float)
    pixels, depths = frame.view.camera.project(sweep.points)
    columns, rows = np.floor(pixels).astype(int).T
    seen = (depths > 1) & (depths < 40) & (columns >= 0) & (columns < 480) & (rows >= 0) & (rows < 270)

    def greenness(class_number):
        chosen = seen & (sweep.classes == class_number)
        assert chosen.sum() > 200
        red, green, blue = image[rows[chosen], columns[chosen]].T
        return float(np.mean(green - (red + blue) / 2))

    assert greenness(5) > greenness(41) + 5
