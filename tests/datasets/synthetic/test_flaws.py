"""Flaws of a recording: each changes what it should, and the truth beside it stays that of the standard clip."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import RecordingFlaws, StreetConfig
from instdrive_core.datasets.synthetic.flaws import compute_exposure_factor, disturb_pose, shift_box
from instdrive_core.datasets.synthetic.sensors import rolling_shutter
from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene
from instdrive_core.datasets.synthetic.sensors.render import EXPOSURE, StepRenderer
from instdrive_core.datasets.synthetic.sensors.rolling_shutter import Exposure, compute_row_times, photograph_rows
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose
from instdrive_core.datasets.synthetic.world.ground import STREET_SPAN
from instdrive_core.datasets.synthetic.world.layout import build_street, compute_street_span
from instdrive_core.datasets.synthetic.world.rig import CAMERAS
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import OptionError
from instdrive_core.files.restricted_pickle import read_pickle
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.track import find_points_inside

FLAWS = RecordingFlaws(
    shutter_seconds=0.002, position_noise=0.01, rotation_noise=0.05, exposure_stops=1.0, cuboid_error=0.1,
    twin_cuboids=True,
)  # fmt: skip
STEPS = 2


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One street, recorded without and with all flaws."""
    root = tmp_path_factory.mktemp("flaws")
    for name, flaws in (("plain", RecordingFlaws()), ("flawed", FLAWS)):
        config = StreetConfig(seed=3, steps=STEPS, width=64, height=36, lidar_azimuths=200, flaws=flaws)
        write_street(root / name, config)
    return root / "plain", root / "flawed"


def positions(poses: list[dict[str, dict[str, float]]]) -> np.ndarray:
    return np.array([[pose["position"][axis] for axis in "xyz"] for pose in poses])


def boxes_of(file: Path) -> dict[str, np.ndarray]:
    table = read_pickle(file)
    return {
        uuid: np.array([table[f"position.{axis}"][row] for axis in "xyz"]) for row, uuid in enumerate(table["uuid"])
    }


def test_points_labels_and_instances_are_those_of_the_flawless_clip(clips: tuple[Path, Path]) -> None:
    plain, flawed = clips
    for pattern in ("lidar/*.pkl.gz", "labels/lidar/*.npy", "labels/instances.json"):
        files = sorted(path.relative_to(plain) for path in plain.glob(pattern))
        assert files
        assert all((plain / file).read_bytes() == (flawed / file).read_bytes() for file in files)
    assert not (plain / "labels" / "poses.json").exists()
    assert not (plain / "labels" / "cuboids").exists()


def test_written_poses_are_noisy_and_the_true_ones_are_kept(clips: tuple[Path, Path]) -> None:
    plain, flawed = clips
    truth = json.loads((flawed / "labels" / "poses.json").read_text())
    assert set(truth) == {*(camera.name for camera in CAMERAS), "lidar"}
    offsets = []
    for name, poses in truth.items():
        folder = Path("lidar") if name == "lidar" else Path("camera") / name
        assert poses == json.loads((plain / folder / "poses.json").read_text())
        offsets.append(positions(json.loads((flawed / folder / "poses.json").read_text())) - positions(poses))
    assert 0.006 < np.concatenate(offsets).std() < 0.014
    assert np.abs(np.diff(offsets[0], axis=0)).max() > 1e-3, "every photo has an error of its own"


def test_noise_of_rotations_is_as_large_as_asked_for() -> None:
    flaws = RecordingFlaws(rotation_noise=0.5)
    turned = [disturb_pose(np.eye(4), flaws, 0, 1, step)[:3, :3] for step in range(300)]
    angles = np.degrees([np.arccos((np.trace(turn) - 1) / 2) for turn in turned])
    assert np.sqrt(np.mean(angles**2) / 3) == pytest.approx(0.5, rel=0.1)


def test_cuboids_are_off_by_the_error_asked_for_and_truth_has_the_exact_ones(clips: tuple[Path, Path]) -> None:
    plain, flawed = clips
    assert shift_box(np.eye(4), 0.1, 0, 1, 0)[2, 3] == 0, "boxes stay on the ground"
    errors = []
    for step in range(STEPS):
        name = f"{step:02d}.pkl.gz"
        exact = plain / "annotations" / "cuboids" / name
        assert (flawed / "labels" / "cuboids" / name).read_bytes() == exact.read_bytes()
        true, written = boxes_of(exact), boxes_of(flawed / "annotations" / "cuboids" / name)
        errors.append([written[uuid] - place for uuid, place in true.items()])
    offsets = np.array(errors)
    assert np.sqrt((offsets**2).sum(axis=2).mean()) == pytest.approx(0.1, rel=0.1)
    lasting = offsets.mean(axis=0)[:, :2].std()
    assert lasting == pytest.approx(0.05 * np.sqrt(1 + 1 / STEPS), rel=0.15), "half of it stays with the object"


def test_movers_are_annotated_twice_and_read_as_one(clips: tuple[Path, Path]) -> None:
    plain, flawed = clips
    once = load_clip(str(plain), ClipOptions(scale=1.0))
    twice = read_pickle(flawed / "annotations" / "cuboids" / "00.pkl.gz")
    second = twice["cuboids.sensor_id"] == 1
    assert second.sum() == (twice["cuboids.sensor_id"] == 0).sum() > 10
    assert set(twice["cuboids.sibling_id"]) == {"-"}
    assert len(set(twice["uuid"])) == len(once.tracks) + second.sum()
    loaded = load_clip(str(flawed), ClipOptions(scale=1.0))
    left = {track.id for track in loaded.tracks} - {track.id for track in once.tracks}
    assert len(left) <= 0.2 * second.sum(), "few twins, people in two steps, lie too far apart to be known as one"
    true = {track.id: track for track in loaded.true_tracks}
    for track in once.tracks:
        np.testing.assert_array_equal(true[track.id].world_from_box[:, :3, :3], track.world_from_box[:, :3, :3])
    assert once.exact_tracks == ()


def test_exposure_drifts_within_its_stops_differently_for_each_camera() -> None:
    flaws = RecordingFlaws(exposure_stops=0.5)
    stops = np.log2(
        [[compute_exposure_factor(flaws, 1, camera, 0.1 * step) for step in range(80)] for camera in (0, 1)]
    )
    assert np.abs(stops).max() <= 0.5
    assert np.ptp(stops, axis=1).min() > 0.3
    assert np.abs(stops[0] - stops[1]).max() > 0.1
    assert np.abs(np.diff(stops, axis=1)).max() < 0.35, "no photo is twice as bright as the one before"


def test_rows_of_a_rolling_shutter_show_their_own_moments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rolling_shutter, "SLICE_SECONDS", 0.02)
    street, time, seconds = build_street(StreetConfig(seed=3)), 1.0, 0.1
    standing = RayScene(street.standing.mesh.corners)

    def place(moment: float) -> Camera:
        return CAMERAS[3].place(compute_ego_pose(street, moment), 64, 36)

    with ThreadPoolExecutor(2) as pool:
        rolling = photograph_rows(street, standing, [Exposure(place, EXPOSURE)], time, seconds, pool)[0]
    times = compute_row_times(time, seconds, 36)
    assert np.mean(times) == pytest.approx(time)
    for row in (0, 35):
        renderer = StepRenderer(street.geometry(times[row]), street.materials, street.light)
        still = renderer.photograph(place(times[row]))
        assert (still.labels[row] == rolling.labels[row]).mean() > 0.95
        assert (np.abs(still.image[row].astype(int) - rolling.image[row]) < 3).mean() > 0.7
    renderer = StepRenderer(street.geometry(time), street.materials, street.light)
    at_once = renderer.photograph(place(time))
    outer, inner = [0, 1, 34, 35], slice(17, 19)
    differs = np.abs(at_once.image.astype(int) - rolling.image).mean(axis=(1, 2))
    assert differs[outer].mean() > 3 * differs[inner].mean()


def test_long_drives_lengthen_the_street_and_nobody_runs_into_anybody() -> None:
    assert compute_street_span(20) == compute_street_span(100) == STREET_SPAN
    steps = 300
    street, span = build_street(StreetConfig(seed=5, steps=steps)), compute_street_span(steps)
    end = (steps - 1) * StreetConfig().step_seconds
    assert compute_ego_pose(street, end)[1, 3] > 200
    vehicles = [actor for actor in street.actors if actor.motion is not None]
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0, 0.5) for z in (-0.4, 0.4)])
    for time in (0.0, end / 2, end):
        poses = np.array([street.box_pose(actor, time) for actor in vehicles])
        driving = [number for number, actor in enumerate(vehicles) if actor.motion == "Moving"]
        ego = compute_ego_pose(street, time)[:2, 3]
        assert (np.linalg.norm(poses[driving, :2, 3] - ego, axis=1) < 60).sum() >= 3, "there is traffic all the way"
        assert (poses[:, 1, 3] > span[0]).all()
        assert (poses[:, 1, 3] < span[1]).all()
        for number in driving:
            outline = corners * vehicles[number].dimensions @ poses[number, :3, :3].T + poses[number, :3, 3]
            near = np.linalg.norm(poses[:, :2, 3] - poses[number, :2, 3], axis=1) < 10
            near[number] = False
            for other in np.flatnonzero(near):
                assert not find_points_inside(outline, poses[other], vehicles[other].dimensions).any()


def test_refuses_flaws_out_of_range() -> None:
    with pytest.raises(OptionError, match=r"shutter_seconds is 0\.5; choose 0 to 0\.1"):
        RecordingFlaws(shutter_seconds=0.5)
    with pytest.raises(OptionError, match="cuboid_error"):
        RecordingFlaws(cuboid_error=-1)
