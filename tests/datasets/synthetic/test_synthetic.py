"""The synthetic clip: layout, determinism, and that photos, LiDAR, boxes and labels tell the same story."""

from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from written_poses import pose_matrix

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import PANDAR64, StreetConfig
from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene
from instdrive_core.datasets.synthetic.sensors.render import compute_subsample_directions
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.rig import CAMERAS, EGO_HEIGHT, compute_beam_elevations
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.restricted_pickle import read_pickle
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.track import find_points_inside

CONFIG = StreetConfig(seed=3, steps=3, width=192, height=108, lidar_azimuths=500)
STANDARD = StreetConfig(seed=7)
CUBOID_COLUMNS = (
    "uuid", "label", "yaw", "stationary", "camera_used", "position.x", "position.y", "position.z", "dimensions.x",
    "dimensions.y", "dimensions.z", "attributes.object_motion", "cuboids.sibling_id", "cuboids.sensor_id",
    "attributes.rider_status", "attributes.pedestrian_behavior", "attributes.pedestrian_age",
)  # fmt: skip


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("synthetic") / "clip"
    write_street(path, CONFIG)
    return path


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(CONFIG)


def camera_of(clip: Path, name: str, step: int) -> Camera:
    folder = clip / "camera" / name
    numbers = json.loads((folder / "intrinsics.json").read_text())
    pose = pose_matrix(json.loads((folder / "poses.json").read_text())[step])
    return Camera(**numbers, width=CONFIG.width, height=CONFIG.height, world_from_camera=pose)


def sweep_of(clip: Path, step: int) -> tuple[np.ndarray, np.ndarray]:
    """World points and their exact instance IDs."""
    table = read_pickle(clip / "lidar" / f"{step:02d}.pkl.gz")
    points = np.stack([table[axis] for axis in "xyz"], axis=1)
    return points, np.load(clip / "labels" / "lidar" / f"{step:02d}.npy")


def instances_of(clip: Path) -> dict[int, dict]:
    return {int(key): value for key, value in json.loads((clip / "labels" / "instances.json").read_text()).items()}


def test_holds_the_files_of_pandaset_and_the_labels_beside_them(clip: Path) -> None:
    steps = [f"{step:02d}" for step in range(CONFIG.steps)]
    cameras = [camera.name for camera in CAMERAS]
    expected = {f"camera/{name}/{step}.jpg" for name in cameras for step in steps}
    expected |= {f"camera/{name}/{file}.json" for name in cameras for file in ("intrinsics", "poses", "timestamps")}
    expected |= {f"{folder}/{step}.pkl.gz" for step in steps
                 for folder in ("lidar", "annotations/cuboids", "annotations/semseg")}  # fmt: skip
    expected |= {"lidar/poses.json", "lidar/timestamps.json", "annotations/semseg/classes.json"}
    expected |= {"meta/gps.json", "meta/timestamps.json", "labels/instances.json", "labels/street.json"}
    expected |= {f"labels/{name}/{step}.png" for name in cameras for step in steps}
    expected |= {f"labels/sky/{name}/{step}.png" for name in cameras for step in steps}
    expected |= {f"labels/lidar/{step}.npy" for step in steps}
    assert {str(path.relative_to(clip)) for path in clip.rglob("*") if path.is_file()} == expected


def test_tables_have_the_columns_and_types_of_pandaset(clip: Path, pandaset_clip: Path) -> None:
    for folder, ours, theirs in (("lidar", "00", "30"), ("annotations/cuboids", "00", "30"),
                                 ("annotations/semseg", "00", "30")):  # fmt: skip
        mine = read_pickle(clip / folder / f"{ours}.pkl.gz")
        real = read_pickle(pandaset_clip / folder / f"{theirs}.pkl.gz")
        assert list(mine) == list(real)
        assert [column.dtype for column in mine.values()] == [column.dtype for column in real.values()]
        # pandas' own kinds of text change with its version and with pyarrow at hand.
        assert b"StringArray" not in gzip.decompress((clip / folder / f"{ours}.pkl.gz").read_bytes())
    classes = "annotations/semseg/classes.json"
    assert json.loads((clip / classes).read_text()) == json.loads((pandaset_clip / classes).read_text())


def test_cuboids_list_every_actor_at_every_step(clip: Path) -> None:
    ids = {item["uuid"] for item in instances_of(clip).values() if item["uuid"]}
    for step in range(CONFIG.steps):
        table = read_pickle(clip / "annotations" / "cuboids" / f"{step:02d}.pkl.gz")
        assert tuple(table) == CUBOID_COLUMNS
        assert set(table["uuid"]) == ids
        assert set(table["cuboids.sibling_id"]) == {"-"}
        assert min(table["dimensions.x"].min(), table["dimensions.y"].min()) > 0.1


def test_the_data_set_loader_reads_it_without_special_treatment(clip: Path) -> None:
    loaded = load_clip(str(clip), ClipOptions(scale=1.0))
    assert len(loaded.frames) == 6 * CONFIG.steps
    assert loaded.frames[0].load_image().shape == (CONFIG.height, CONFIG.width, 3)
    assert [sweep.index for sweep in loaded.sweeps] == list(range(CONFIG.steps))
    points = loaded.sweeps[0].load()
    assert points.instance_labels is not None
    assert len(points.instance_labels) == len(points.points) > 15_000
    moving = {key: item["moving"] for item in instances_of(clip).values() if (key := item["uuid"])}
    assert {track.id: track.moving for track in loaded.tracks} == moving


def digest(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.slow
def test_a_seed_gives_the_same_files_and_another_seed_others(tmp_path: Path) -> None:
    runs = {}
    for name, seed in (("first", 11), ("again", 11), ("other", 12)):
        build_street.cache_clear()
        write_street(tmp_path / name, StreetConfig(seed=seed, steps=1, width=96, height=54, lidar_azimuths=60))
        runs[name] = digest(tmp_path / name)
    assert runs["first"] == runs["again"]
    changed = {file for file, value in runs["other"].items() if value != runs["first"][file]}
    assert {file for file in changed if file.endswith(".jpg")} == {f"camera/{c.name}/00.jpg" for c in CAMERAS}
    assert "annotations/cuboids/00.pkl.gz" in changed


def test_poses_put_every_camera_where_the_rig_has_it(clip: Path, street: Street) -> None:
    world = street.world_from_street()
    for step in range(CONFIG.steps):
        ego = world @ compute_ego_pose(street, step * CONFIG.step_seconds)
        for rig_camera in CAMERAS:
            expected = rig_camera.place(ego, CONFIG.width, CONFIG.height)
            actual = camera_of(clip, rig_camera.name, step)
            np.testing.assert_allclose(actual.world_from_camera, expected.world_from_camera, atol=1e-9)
            np.testing.assert_allclose(actual.intrinsics, expected.intrinsics)
            above_road = actual.position[2] - ego[2, 3] + EGO_HEIGHT
            assert 1.8 < above_road < 2.3
    np.testing.assert_allclose((world @ compute_ego_pose(street, 0.0))[:3, 3], 0, atol=1e-9)


def test_intrinsics_are_the_real_ones_scaled(clip: Path, pandaset_clip: Path) -> None:
    scale = CONFIG.width / 1920
    for camera in CAMERAS:
        file = f"camera/{camera.name}/intrinsics.json"
        real = json.loads((pandaset_clip / file).read_text())
        ours = json.loads((clip / file).read_text())
        assert ours == pytest.approx({name: value * scale for name, value in real.items()})


def seen_from(rays: RayScene, camera: Camera, points: np.ndarray) -> np.ndarray:
    """Whether nothing stands between a camera and points, both in the street's frame."""
    offset = points - camera.position
    distance = np.linalg.norm(offset, axis=1)
    directions = (offset / distance[:, None]).astype(np.float32)
    origins = np.repeat(camera.position[None].astype(np.float32), len(points), axis=0)
    return np.abs(rays.find_first_hits(origins, directions).distances - distance) < 0.15


def test_pixel_labels_agree_with_lidar_labels_where_the_camera_sees_the_points(clip: Path, street: Street) -> None:
    points, labels = sweep_of(clip, 1)
    rays = RayScene(street.geometry(1 * CONFIG.step_seconds).mesh.corners)
    street_from_world = np.linalg.inv(street.world_from_street())
    local = points @ street_from_world[:3, :3].T + street_from_world[:3, 3]
    agree, total = 0, 0
    for rig_camera in CAMERAS:
        pixels, depth = camera_of(clip, rig_camera.name, 1).project(points)
        column, row = np.floor(pixels).astype(int).T
        inside = (depth > 0.5) & (column >= 0) & (column < CONFIG.width) & (row >= 0) & (row < CONFIG.height)
        posed = rig_camera.place(compute_ego_pose(street, 1 * CONFIG.step_seconds), CONFIG.width, CONFIG.height)
        chosen = np.flatnonzero(inside)
        chosen = chosen[seen_from(rays, posed, local[chosen])]
        label_map = np.asarray(Image.open(clip / "labels" / rig_camera.name / "01.png"))
        agree += int((label_map[row[chosen], column[chosen]] == labels[chosen]).sum())
        total += len(chosen)
    assert total > 15_000
    assert agree / total > 0.95


def test_boxes_hold_their_instances_points_and_nothing_else(clip: Path) -> None:
    instances = instances_of(clip)
    own_total = own_inside = other_inside = 0
    for step in range(CONFIG.steps):
        points, labels = sweep_of(clip, step)
        table = read_pickle(clip / "annotations" / "cuboids" / f"{step:02d}.pkl.gz")
        rows = {uuid: row for row, uuid in enumerate(table["uuid"])}
        for key, item in instances.items():
            if item["uuid"] is None:
                continue
            row = rows[item["uuid"]]
            centre = np.array([table[f"position.{axis}"][row] for axis in "xyz"])
            half = np.array([table[f"dimensions.{axis}"][row] for axis in "xyz"]) / 2
            cosine, sine = np.cos(table["yaw"][row]), np.sin(table["yaw"][row])
            local = (points - centre) @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
            own = labels == key
            own_total += int(own.sum())
            own_inside += int((np.abs(local[own]) < half + 0.07).all(axis=1).sum())
            other = local[~own]
            above_road = other[:, 2] > -half[2] + 0.15
            other_inside += int(((np.abs(other) < half - 0.05).all(axis=1) & above_road).sum())
    assert own_total > 3000
    assert own_inside / own_total > 0.995
    assert other_inside / own_total < 0.01


def test_a_moving_cars_label_follows_it(clip: Path) -> None:
    """IDs are constant in time: a moving car's points shift by its speed between steps, in its own direction."""
    table = [read_pickle(clip / "annotations" / "cuboids" / f"{step:02d}.pkl.gz") for step in (0, 2)]
    shifts = []
    for key, item in instances_of(clip).items():
        if item["uuid"] is None or not item["moving"]:
            continue
        row = list(table[0]["uuid"]).index(item["uuid"])
        sets = [points[labels == key] for points, labels in (sweep_of(clip, 0), sweep_of(clip, 2))]
        if min(len(points) for points in sets) < 150:
            continue
        box = [np.array([t[f"position.{axis}"][row] for axis in "xy"]) for t in table]
        seen = [points[:, :2].mean(axis=0) for points in sets]
        shifts.append(np.linalg.norm((seen[1] - seen[0]) - (box[1] - box[0])))
        assert 0.5 < np.linalg.norm(box[1] - box[0]) < 2.5
    assert len(shifts) >= 2
    assert np.median(shifts) < 0.3


def test_sky_masks_and_instance_list_match_the_label_maps(clip: Path) -> None:
    instances = instances_of(clip)
    sky_pixels = 0
    for camera in CAMERAS:
        for step in range(CONFIG.steps):
            labels = np.asarray(Image.open(clip / "labels" / camera.name / f"{step:02d}.png"))
            sky = np.asarray(Image.open(clip / "labels" / "sky" / camera.name / f"{step:02d}.png"))
            assert labels.dtype == np.uint16
            np.testing.assert_array_equal(sky, np.where(labels == 0, 255, 0))
            assert set(np.unique(labels)) - {0} <= set(instances)
            sky_pixels += int((labels == 0).sum())
    assert sky_pixels > 0.02 * labels.size * 6 * CONFIG.steps
    stuff = {item["class"] for item in instances.values() if item["kind"] == "stuff"}
    assert stuff == {"Road", "Sidewalk", "Ground"}


def test_semantic_classes_are_those_of_the_instances_except_for_paint_on_the_road(clip: Path) -> None:
    names = {int(k): v for k, v in json.loads((clip / "annotations/semseg/classes.json").read_text()).items()}
    instances = instances_of(clip)
    _, labels = sweep_of(clip, 0)
    classes = read_pickle(clip / "annotations" / "semseg" / "00.pkl.gz")["class"]
    own = np.array([instances[int(label)]["class"] for label in labels])
    given = np.array([names[int(number)] for number in classes])
    different = given != own
    assert set(own[different]) == {"Road"}
    assert {"Lane Line Marking", "Other Road Marking"} <= set(given[different])


def test_sweeps_are_noisy_returns_of_64_beams_within_range(clip: Path) -> None:
    table = read_pickle(clip / "lidar" / "00.pkl.gz")
    pose = pose_matrix(json.loads((clip / "lidar" / "poses.json").read_text())[0])
    local = (np.stack([table[axis] for axis in "xyz"], axis=1) - pose[:3, 3]) @ pose[:3, :3]
    ranges = np.linalg.norm(local, axis=1)
    elevations = np.arcsin(local[:, 2] / ranges)
    assert ranges.max() < 120.2
    assert np.abs(elevations[:, None] - compute_beam_elevations(PANDAR64)).min(axis=1).max() < 1e-3
    assert table["i"].min() >= 0
    assert 20 < table["i"].std() < 100
    assert table["i"].max() <= 255
    assert set(table["d"]) == {0}


def pixels_per_instance(street: Street, times: tuple[float, ...]) -> dict[int, int]:
    """Subsamples that each instance covers in all cameras' views of 160×90, by geometry only."""
    counts: dict[int, int] = {}
    for time in times:
        geometry = street.geometry(time)
        rays = RayScene(geometry.mesh.corners)
        for rig_camera in CAMERAS:
            camera = rig_camera.place(compute_ego_pose(street, time), 160, 90)
            directions = compute_subsample_directions(camera, slice(0, 90))
            origins = np.repeat(camera.position[None].astype(np.float32), len(directions), axis=0)
            triangles = rays.find_first_hits(origins, directions).triangles
            ids, pixels = np.unique(geometry.instances[triangles[triangles >= 0]], return_counts=True)
            for key, count in zip(ids.tolist(), pixels.tolist(), strict=True):
                counts[key] = counts.get(key, 0) + count
    return counts


def test_the_standard_clip_shows_enough_instances_and_movers() -> None:
    street = build_street(STANDARD)
    counts = pixels_per_instance(street, (0.0, 0.9, 1.9))
    instances = {item.id: item for item in street.instances((STANDARD.steps - 1) * CONFIG.step_seconds)}
    visible = {key for key, count in counts.items() if count >= 12}
    moving = [instances[key] for key in visible if instances[key].moving]
    assert len(visible) >= 60
    assert len(moving) >= 10
    assert {"Car", "Bicycle"} <= {item.label for item in moving}
    assert any(item.label.startswith("Pedestrian") for item in moving)
    shapes = {tuple(np.round(actor.dimensions, 2)) for actor in street.actors if actor.label == "Car"}
    assert len(shapes) >= 3


def test_vehicles_keep_clear_of_each_other(street: Street) -> None:
    vehicles = [actor for actor in street.actors if actor.motion is not None]
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0, 0.5) for z in (-0.4, 0.4)])
    for time in (0.0, 1.9):
        poses = [street.box_pose(actor, time) for actor in vehicles]
        for actor, pose in zip(vehicles, poses, strict=True):
            outline = corners * actor.dimensions @ pose[:3, :3].T + pose[:3, 3]
            others = [(other, box) for other, box in zip(vehicles, poses, strict=True) if other is not actor]
            assert not any(find_points_inside(outline, box, other.dimensions).any() for other, box in others)


def test_refuses_a_folder_that_holds_something(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DataError, match="not an empty folder"):
        write_street(tmp_path, CONFIG)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("options", [{"steps": 0}, {"steps": 401}, {"width": 4}, {"seed": -1}])
def test_refuses_options_out_of_range(options: dict[str, int]) -> None:
    with pytest.raises(OptionError, match=next(iter(options))):
        StreetConfig(**options)
