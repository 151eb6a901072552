"""A recording in the layouts of data sets, read back by their readers and by COCO's own."""

import base64
import io
import json

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.cli.recording.simulate import Layout
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import find_data_set, load_clip
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import save_scene
from instdrive_core.masks.ground_truth import find_ground_truth
from instdrive_core.masks.label_map_folder import open_masks
from instdrive_core.recording.boxes import place_boxes
from instdrive_core.recording.coco import encode_run_lengths
from instdrive_core.recording.drive import Drive
from instdrive_core.recording.folder import read_color, read_id_map
from instdrive_core.recording.layouts import LAYOUTS, WRITERS, write_recorded_layout
from instdrive_core.recording.plan import RecordOptions, plan_views
from instdrive_core.recording.reading import read_recorded_clip
from instdrive_core.recording.record import record_drive
from instdrive_core.recording.sweep_files import MomentSweep
from instdrive_core.recording.things import find_boxed_things

WHOLE = ClipOptions(scale=1.0)
POINTS = 7


@pytest.fixture(scope="module")
def scene():
    scene = random_scene(count=300)
    scene.gaussians.log_scales[:] = -1.2
    scene.gaussians.opacity_logits[:] = 3
    return scene


def cast(step, time):
    rng = np.random.default_rng(step)
    points = rng.normal(0, 5, (POINTS, 3)).astype(np.float32)
    times = np.full(POINTS, time)
    pose = np.eye(4)
    pose[:3, 3] = (0, -8, 2)
    return MomentSweep(points, np.full(POINTS, 0.5, np.float32), times, np.arange(POINTS, dtype=np.uint32), pose)


@pytest.fixture(scope="module")
def recorded(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording") / "out"
    record_drive(folder, Drive(scene, plan_views(scene, RecordOptions()), cast_sweep=cast))
    return folder


def test_the_command_offers_every_layout():
    assert set(Layout.__args__) == set(WRITERS)


def test_a_recording_reads_back_as_a_clip(scene, recorded):
    clip = read_recorded_clip(recorded)
    assert [frame.view.camera.world_from_camera.tolist() for frame in clip.frames] == [
        view.camera.world_from_camera.tolist() for view in scene.views
    ]
    expected = {str(box.thing.instance.id): box for box in place_boxes(scene, find_boxed_things(scene), 0.2)}
    there = {track.id: track for track in clip.tracks if track.covers(0.2, 0.01)}
    assert set(there) == set(expected)
    for name, track in there.items():
        np.testing.assert_allclose(track.interpolate_pose(0.2), expected[name].world_from_box, atol=1e-5)
    sweep = clip.sweeps[2].load()
    np.testing.assert_array_equal(sweep.points, cast(2, 0.2).points)
    np.testing.assert_array_equal(sweep.instance_labels, np.arange(POINTS))


@pytest.mark.parametrize("layout", sorted(set(WRITERS) - {"coco", "mcap"}))
def test_every_layout_opens_with_photos_sweeps_and_boxes(scene, recorded, layout):
    opened = write_recorded_layout(recorded, layout)
    assert opened == write_recorded_layout(recorded, layout), "it is there already"
    clip = load_clip(str(opened), WHOLE)
    assert len(clip.frames) == len(scene.views)
    assert len(clip.sweeps) == len(scene.views)
    assert len(clip.sweeps[0].load().points) == POINTS
    assert clip.tracks
    picture = clip.frames[0].load_image().astype(int)
    assert np.abs(picture - read_color(recorded / "color/front_camera/00.png")).mean() < 8
    # Layouts number boxes their own way; how far each is from the camera stays.
    made, known = (list_distances(one) for one in (clip, read_recorded_clip(recorded)))
    assert len(made) > 0
    assert all(np.abs(known - distance).min() < 0.02 for distance in made)


def list_distances(clip):
    """Distances of all boxes that are there at first from the first camera."""
    eye, time = clip.frames[0].view.camera.position, clip.frames[0].view.time
    there = [track for track in clip.tracks if track.covers(time, 0.01)]
    return np.array([np.linalg.norm(track.interpolate_pose(time)[:3, 3] - eye) for track in there])


def test_pandaset_has_the_editors_ids_as_exact_labels(recorded):
    opened = write_recorded_layout(recorded, "pandaset")
    assert find_data_set(str(opened)).title == "PandaSet"
    clip = load_clip(str(opened), WHOLE)
    truth = find_ground_truth(clip)
    assert truth.source == "exact"
    np.testing.assert_array_equal(truth.load(clip.frames[0]), read_id_map(recorded / "instances/front_camera/00.png"))
    masks, frame = open_masks(opened / "masks"), clip.training_frames[0]
    assert masks.source == "exact"
    assert set(masks.counts) == {each.key for each in clip.training_frames}
    assert masks.counts[frame.key] == np.count_nonzero(np.unique(truth.load(frame)))
    table = pd.read_pickle(opened / "annotations/cuboids/02.pkl.gz")
    boxes = {box["id"]: box for box in json.loads((recorded / "moments/02.json").read_text())["boxes"]}
    assert set(table["uuid"]) == {str(number) for number in boxes}
    assert set(pd.read_pickle(opened / "lidar/00.pkl.gz").columns) == {*"xyzitd"}


# pycocotools' own way with NumPy's arrays
FROM_PYCOCOTOOLS = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")


@FROM_PYCOCOTOOLS
def test_coco_is_what_pycocotools_reads(recorded):
    from pycocotools.coco import COCO

    opened = write_recorded_layout(recorded, "coco")
    coco = COCO(str(opened / "instances.json"))
    assert len(coco.getImgIds()) == 5
    for image in coco.loadImgs(coco.getImgIds()):
        ids = read_id_map(recorded / "instances" / image["file_name"])
        for annotation in coco.loadAnns(coco.getAnnIds(imgIds=image["id"])):
            mask = ids == annotation["instance_id"]
            np.testing.assert_array_equal(coco.annToMask(annotation).astype(bool), mask)
            assert annotation["area"] == mask.sum()
            assert coco.loadCats(annotation["category_id"])[0]["isthing"] == 1
    panoptic = json.loads((opened / "panoptic.json").read_text())
    assert len(panoptic["annotations"]) == 5
    for entry in panoptic["annotations"]:
        with Image.open(opened / "panoptic" / entry["file_name"]) as picture:
            pixels = np.asarray(picture).astype(int)
        ids = pixels[..., 0] + 256 * pixels[..., 1] + 65536 * pixels[..., 2]
        assert {segment["id"]: segment["area"] for segment in entry["segments_info"]} == {
            number: int((ids == number).sum()) for number in np.unique(ids).tolist() if number
        }


@FROM_PYCOCOTOOLS
@pytest.mark.parametrize("mask", [np.eye(3, 4, dtype=bool), np.ones((2, 2), bool), np.zeros((2, 3), bool)])
def test_run_lengths_are_those_of_pycocotools(mask):
    from pycocotools import mask as tools

    encoded = encode_run_lengths(mask)
    decoded = tools.decode(tools.frPyObjects(encoded, *mask.shape))
    np.testing.assert_array_equal(decoded.astype(bool), mask)


def test_mcap_is_what_its_reader_reads(scene, recorded):
    from mcap.reader import make_reader

    opened = write_recorded_layout(recorded, "mcap")
    topics = {}
    with opened.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert channel.message_encoding == "json"
            content, fields = json.loads(message.data), json.loads(schema.data)["properties"]
            assert set(content) == set(fields), schema.name
            topics.setdefault(channel.topic, []).append((message.log_time, content))
    assert set(topics) == {
        *("/tf", "/boxes", "/lidar"),
        *("/camera/front_camera/image", "/camera/front_camera/calibration"),
    }
    assert all(len(messages) == 5 for messages in topics.values())
    time, image = topics["/camera/front_camera/image"][2]
    assert time == pytest.approx(0.2e9)
    picture = Image.open(io.BytesIO(base64.b64decode(image["data"])))
    np.testing.assert_array_equal(np.asarray(picture), read_color(recorded / "color/front_camera/02.png"))
    boxes = json.loads((recorded / "moments/02.json").read_text())["boxes"]
    entities = topics["/boxes"][2][1]["entities"]
    assert [entity["id"] for entity in entities] == [str(box["id"]) for box in boxes]
    assert list(entities[0]["cubes"][0]["pose"]["position"].values()) == boxes[0]["center"]
    cloud = topics["/lidar"][2][1]
    rows = np.frombuffer(base64.b64decode(cloud["data"]), [("xyz", "<f4", 3), ("i", "<f4"), ("instance", "<u4")])
    np.testing.assert_array_equal(rows["xyz"], cast(2, 0.2).points)
    np.testing.assert_array_equal(rows["instance"], np.arange(POINTS))
    assert cloud["point_stride"] == rows.itemsize


def test_an_unfinished_recording_has_no_layouts(tmp_path):
    with pytest.raises(DataError, match="no finished recording"):
        write_recorded_layout(tmp_path, "pandaset")
    assert not (tmp_path / LAYOUTS).exists()


def test_a_layout_that_fails_leaves_nothing(recorded, monkeypatch):
    def fail(folder, out):
        out.mkdir(parents=True)
        (out / "half").write_text("x")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(WRITERS, "coco2", fail)
    with pytest.raises(DataError, match="No space left"):
        write_recorded_layout(recorded, "coco2")
    assert not list((recorded / LAYOUTS).glob("*coco2*"))


def test_the_command_writes_layouts(scene, tmp_path, capsys):
    save_scene(tmp_path / "run", scene)
    out = tmp_path / "out"
    assert main(["simulate", str(tmp_path / "run"), "-o", str(out), "--last", "1", "--layout", "coco", "t4"]) == 0
    said = capsys.readouterr().out
    assert f"coco: {out / 'layouts/coco/drive'}" in said
    assert load_clip(str(out / "layouts/t4/drive"), WHOLE).frames
