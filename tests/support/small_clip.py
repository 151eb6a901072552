"""A clip of a few bytes in PandaSet's layout: 5 steps of 8 listed, 2 cameras, LiDAR of 3 steps, 2 cars; and the same
drive in every other layout that is written."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.clip_recordings import record_clip
from instdrive_core.datasets.recording import Recording
from instdrive_core.datasets.registry import DATA_SETS, load_clip

pd.options.mode.string_storage = "python"  # pickles are the same whether or not pyarrow is there

STEPS = range(2, 7)
LISTED = 8
LIDAR_STEPS = (2, 4, 6)
WIDTH, HEIGHT = 64, 36
START = np.array([1000.0, 2000.0, 1.5])
"""Where the cameras are in the first listed step; they move 1 m a step along y."""
CLASSES = {"5": "Vegetation", "7": "Road", "8": "Lane Line Marking", "13": "Car", "41": "Building"}
FORWARD = {"w": np.sqrt(0.5), "x": -np.sqrt(0.5), "y": 0.0, "z": 0.0}
"""Heading of a camera that looks along the world's y axis, x to the right, z up."""
BACKWARD = {"w": 0.0, "x": 0.0, "y": np.sqrt(0.5), "z": -np.sqrt(0.5)}
WRITTEN = {data_set.title: data_set for data_set in DATA_SETS if data_set.write is not None}
"""Layouts that are written."""
WHOLE = ClipOptions(scale=1.0)
PARKED, MOVING, TWIN = "parked", "moving", "twin-of-moving"


def write_small_clip(root: Path, suffix: str = ".pkl.gz") -> Path:
    """Write the clip into the folder `root` and return it."""
    for camera, heading in (("front_camera", FORWARD), ("back_camera", BACKWARD)):
        _write_camera(root / "camera" / camera, heading)
    times = [1.6e9 + 0.1 * step for step in range(LISTED)]
    write_json(root / "meta" / "timestamps.json", times)
    write_json(root / "lidar" / "timestamps.json", times)
    write_json(root / "annotations" / "semseg" / "classes.json", CLASSES)
    for step in LIDAR_STEPS:
        points, classes, sensors = sweep_at(step)
        table = {name: points[:, column] for column, name in enumerate("xyz")}
        table |= {"i": np.full(len(points), 51.0), "t": np.full(len(points), times[step]), "d": sensors}
        write_table(root / "lidar" / f"{step:02d}{suffix}", table)
        write_table(root / "annotations" / "semseg" / f"{step:02d}{suffix}", {"class": classes})
    for step in STEPS:
        write_table(root / "annotations" / "cuboids" / f"{step:02d}{suffix}", cuboids_at(step))
    return root


def record_small_clip(folder: Path) -> Recording:
    """The clip as a recording; its files are in `folder`."""
    return record_clip(load_clip(str(write_small_clip(folder)), WHOLE))


def write_layout(title: str, folder: Path) -> Path:
    """Write the clip in a layout and return the folder to open."""
    recording = record_small_clip(folder.parent / f"{folder.name}-source")
    return WRITTEN[title].write(recording, folder)


def write_exact_labels(root: Path) -> Path:
    """Write labels beside a small clip, the road everywhere, and return its folder."""
    for camera in ("front_camera", "back_camera"):
        for step in STEPS:
            for name in (f"{camera}/{step:02d}.png", f"sky/{camera}/{step:02d}.png"):
                (root / "labels" / name).parent.mkdir(parents=True, exist_ok=True)
                value = np.uint8(0) if name.startswith("sky") else np.uint16(7)
                Image.fromarray(np.full((HEIGHT, WIDTH), value)).save(root / "labels" / name)
    table = {"7": {"class": "Road", "kind": "stuff", "moving": False, "uuid": None}}
    write_json(root / "labels" / "instances.json", table)
    return root


def offset(x: float, y: float, z: float) -> np.ndarray:
    """Metres along the world's axes."""
    return np.array([x, y, z])


def sweep_at(step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World points (n, 3), classes and sensors: road, the parked car, the moving car as both LiDARs meet it."""
    moving = moving_position(step)
    points = np.array(
        [
            START + offset(0.0, 10.0, -1.5),
            START + offset(1.0, 12.0, -1.5),
            START + offset(4.0, 12.0, -0.75),
            moving,
            moving + offset(0.4, 0.5, 0.0),
            moving + offset(0.0, 2.9, 0.0),  # the second LiDAR meets the car later: outside of the box
        ]
    )
    return points, np.array([7, 8, 13, 13, 13, 13]), np.array([0, 0, 0, 0, 0, 1])


def moving_position(step: int) -> np.ndarray:
    """Centre of the moving car in the world."""
    return START + offset(-3.0, 8.0 + 1.5 * step, -0.75)


def cuboids_at(step: int) -> dict[str, np.ndarray]:
    """The cuboid table of a step: a parked car, and a moving one twice."""
    centers = np.array(
        [START + offset(4.0, 12.0, -0.75), moving_position(step), moving_position(step) + offset(0.0, 0.6, 0.0)]
    )
    table = {
        "uuid": np.array([PARKED, MOVING, TWIN], object),
        "label": np.array(["Car"] * 3, object),
        "yaw": np.array([np.pi / 2, 0.0, 0.0]),
        "stationary": np.array([True, False, False]),
        "camera_used": np.full(3, -1),
    }
    table |= {f"position.{axis}": centers[:, column] for column, axis in enumerate("xyz")}
    table |= {f"dimensions.{axis}": np.full(3, size) for axis, size in zip("xyz", (2.0, 4.5, 1.5), strict=True)}
    return table | {
        "attributes.object_motion": np.array(["Parked", "Moving", "Moving"], object),
        "cuboids.sibling_id": np.array(["-", TWIN, MOVING], object),
        "cuboids.sensor_id": np.array([-1, 0, 1]),
    }


def write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    """A pickled DataFrame; gzipped if its name says so."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(columns).to_pickle(path)


def write_json(path: Path, content: object) -> None:
    """A JSON file with its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def photo_at(step: int) -> np.ndarray:
    """A photo (h, w, 3) of 2×2 blocks, each of one colour."""
    rng = np.random.default_rng(step)
    blocks = rng.integers(0, 256, (HEIGHT // 2, WIDTH // 2, 3), dtype=np.uint8)
    return blocks.repeat(2, axis=0).repeat(2, axis=1)


def _write_camera(folder: Path, heading: dict[str, float]) -> None:
    positions = [START + offset(0.0, 1.0 * step, 0.0) for step in range(LISTED)]
    poses = [{"position": dict(zip("xyz", place.tolist(), strict=True)), "heading": heading} for place in positions]
    write_json(folder / "poses.json", poses)
    write_json(folder / "intrinsics.json", {"fx": 40.0, "fy": 42.0, "cx": 31.0, "cy": 17.0})
    write_json(folder / "timestamps.json", [1.6e9 + 0.1 * step for step in range(LISTED)])
    for step in STEPS:
        Image.fromarray(photo_at(step)).save(folder / f"{step:02d}.jpg", quality=100, subsampling=0)
