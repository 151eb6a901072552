"""Records a street: photos, LiDAR, annotations in PandaSet's layout, and exact labels beside them.

Labels lie in ``labels/``, which is no part of PandaSet's layout: ``<camera>/NN.png`` (uint16 instance per pixel, 0 =
sky), ``sky/<camera>/NN.png`` (255 = sky), ``lidar/NN.npy`` (uint32 instance per point) and ``instances.json``. Where a
recording has flaws, the truth lies there too: ``poses.json`` (camera or ``lidar`` → poses) and ``cuboids/NN.pkl.gz``.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image

from instdrive_core.datasets.pickled_tables import describe_pose
from instdrive_core.datasets.synthetic.config import CONFIG_FILE, RecordingFlaws, StreetConfig
from instdrive_core.datasets.synthetic.flaws import (
    Annotation,
    Pose,
    compute_exposure_factor,
    disturb_pose,
    list_annotations,
    shift_box,
)
from instdrive_core.datasets.synthetic.pandaset_files import (
    write_classes,
    write_cuboids,
    write_json,
    write_sweep,
)
from instdrive_core.datasets.synthetic.sensors.lidar import cast_sweep
from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene
from instdrive_core.datasets.synthetic.sensors.render import EXPOSURE, RenderedPhoto, StepRenderer
from instdrive_core.datasets.synthetic.sensors.rolling_shutter import Exposure, photograph_rows
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose, compute_lidar_pose
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.rig import CAMERAS, RigCamera, compute_lidar_directions
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.errors import DataError
from instdrive_core.scene.camera import Camera

START_TIME = 1_600_000_000.0
"""Unix time of step 0."""
_LATITUDE, _LONGITUDE, _ELEVATION = 37.7761, -122.3993, 3.0  # of the world's origin, in PandaSet's city
_METRES_PER_DEGREE = 111_320.0
JPEG_QUALITY = 95

Progress = Callable[[int, int], None]
"""Called with (steps done, all steps)."""


def write_street(out: Path, config: StreetConfig, progress: Progress | None = None) -> None:
    """Write the clip of `config` into the folder `out`, which must be new or empty.

    All sensors record at the same instants, and the LiDAR's turn takes no time: poses, boxes and labels of a step
    fit each other exactly, but for the flaws that `config` asks for. `lidar/poses.json` holds the LiDAR's own poses.

    Raises DataError where `out` holds something already.
    """
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(out, "is not an empty folder", "Choose another one or delete it")
    street = build_street(config)
    times = [step * config.step_seconds for step in range(config.steps)]
    _write_metadata(out, street, config, times)
    recorder = _Recorder(out, street, config, list_annotations(street, config.flaws, config.seed))
    if progress is not None:
        progress(0, config.steps)
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        upcoming = pool.submit(_build_renderer, street, times[0])
        for step, time in enumerate(times):
            renderer = upcoming.result()
            if step + 1 < config.steps:  # built beside the photos of this step
                upcoming = pool.submit(_build_renderer, street, times[step + 1])
            recorder.write_step(step, time, renderer, pool)
            if progress is not None:
                progress(step + 1, config.steps)


def _write_metadata(out: Path, street: Street, config: StreetConfig, times: list[float]) -> None:
    """Write everything that is no picture, point or box."""
    world = street.world_from_street()
    stamps = [START_TIME + time for time in times]
    true_poses: dict[str, list[Pose]] = {}
    for camera in CAMERAS:
        folder = out / "camera" / camera.name
        posed = [camera.place(world @ compute_ego_pose(street, time), config.width, config.height) for time in times]
        true_poses[camera.name] = [view.world_from_camera for view in posed]
        write_json(folder / "timestamps.json", stamps)
        intrinsics = {name: float(getattr(posed[0], name)) for name in ("fx", "fy", "cx", "cy")}
        write_json(folder / "intrinsics.json", intrinsics)
    true_poses["lidar"] = [world @ compute_lidar_pose(street, time) for time in times]
    for sensor, (name, poses) in enumerate(true_poses.items()):
        folder = out / "lidar" if name == "lidar" else out / "camera" / name
        written = [disturb_pose(pose, config.flaws, config.seed, sensor, step) for step, pose in enumerate(poses)]
        write_json(folder / "poses.json", [describe_pose(pose) for pose in written])
    if config.flaws.spoils_poses:
        truth = {name: [describe_pose(pose) for pose in poses] for name, poses in true_poses.items()}
        write_json(out / "labels" / "poses.json", truth)
    write_json(out / "lidar" / "timestamps.json", stamps)
    write_json(out / "meta" / "timestamps.json", stamps)
    write_json(out / "meta" / "gps.json", [_compute_gps(street, world, time) for time in times])
    write_classes(out)
    instances = {
        str(item.id): {"class": item.label, "kind": item.kind, "moving": item.moving, "uuid": item.uuid}
        for item in street.instances(times[-1])
    }
    write_json(out / "labels" / "instances.json", instances)
    write_json(out / CONFIG_FILE, asdict(config))


def _compute_gps(street: Street, world: Float64[ndarray, "4 4"], time: float) -> dict[str, float]:
    """Position and speed over ground, the world's x to the east and y to the north."""
    pose = world @ compute_ego_pose(street, time)
    velocity = street.ego.compute_speed(time) * pose[:3, 1]
    return {
        "lat": _LATITUDE + float(pose[1, 3]) / _METRES_PER_DEGREE,
        "long": _LONGITUDE + float(pose[0, 3]) / (_METRES_PER_DEGREE * float(np.cos(np.radians(_LATITUDE)))),
        "height": _ELEVATION + float(pose[2, 3]),
        "xvel": float(velocity[0]),
        "yvel": float(velocity[1]),
    }


def _build_renderer(street: Street, time: float) -> StepRenderer:
    return StepRenderer(street.geometry(time), street.materials, street.light)


@dataclass(frozen=True)
class _Recorder:
    """Writes the time steps of one clip."""

    out: Path
    street: Street
    config: StreetConfig
    annotations: list[Annotation]

    def write_step(self, step: int, time: float, renderer: StepRenderer, pool: ThreadPoolExecutor) -> None:
        jobs = [pool.submit(self._write_lidar, step, time, renderer)]
        if self.config.flaws.shutter_seconds:
            exposures = [self._expose(number, time) for number in range(len(CAMERAS))]
            seconds = self.config.flaws.shutter_seconds
            photos = photograph_rows(self.street, self._standing, exposures, time, seconds, pool)
            jobs += [
                pool.submit(self._write_photo, camera, step, photo)
                for camera, photo in zip(CAMERAS, photos, strict=True)
            ]
        else:
            jobs += [pool.submit(self._take_photo, number, step, time, renderer) for number in range(len(CAMERAS))]
        self._write_cuboids(step, time)
        for job in jobs:
            job.result()

    @cached_property
    def _standing(self) -> RayScene:
        return RayScene(self.street.standing.mesh.corners)

    def _expose(self, number: int, time: float) -> Exposure:
        config = self.config
        factor = compute_exposure_factor(config.flaws, config.seed, number, time)

        def place(moment: float) -> Camera:
            return CAMERAS[number].place(compute_ego_pose(self.street, moment), config.width, config.height)

        return Exposure(place, EXPOSURE * factor)

    def _take_photo(self, number: int, step: int, time: float, renderer: StepRenderer) -> None:
        taken = self._expose(number, time)
        self._write_photo(CAMERAS[number], step, renderer.photograph(taken.place(time), taken.exposure))

    def _write_photo(self, camera: RigCamera, step: int, photo: RenderedPhoto) -> None:
        _save_image(Image.fromarray(photo.image), self.out / "camera" / camera.name / f"{step:02d}.jpg")
        _save_image(Image.fromarray(photo.labels), self.out / "labels" / camera.name / f"{step:02d}.png")
        sky = np.where(photo.labels == 0, 255, 0).astype(np.uint8)
        _save_image(Image.fromarray(sky), self.out / "labels" / "sky" / camera.name / f"{step:02d}.png")

    def _write_cuboids(self, step: int, time: float) -> None:
        street, config = self.street, self.config
        world, name = street.world_from_street(), f"{step:02d}.pkl.gz"
        poses = [world @ annotation.place_box(street, time) for annotation in self.annotations]
        written = [
            shift_box(pose, config.flaws.cuboid_error, config.seed, number, step) for number, pose in enumerate(poses)
        ]
        write_cuboids(self.out / "annotations" / "cuboids" / name, self.annotations, np.stack(written))
        if config.flaws.spoils_cuboids:
            true = list_annotations(street, RecordingFlaws(), config.seed)
            boxes = np.stack([world @ annotation.place_box(street, time) for annotation in true])
            write_cuboids(self.out / "labels" / "cuboids" / name, true, boxes)

    def _write_lidar(self, step: int, time: float, renderer: StepRenderer) -> None:
        street, config = self.street, self.config
        rng = np.random.default_rng([config.seed, step])  # bare, so that a seed's street stays: see `maths.streams`
        sweep = cast_sweep(
            renderer.rays, renderer.geometry, street.materials, street.semantics(), compute_lidar_pose(street, time),
            compute_lidar_directions(config.lidar, config.lidar_azimuths), rng,
        )  # fmt: skip
        write_sweep(self.out, step, sweep, street.world_from_street(), START_TIME + time)
        path = self.out / "labels" / "lidar" / f"{step:02d}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, sweep.instances)


def _save_image(image: Image.Image, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".jpg":
        image.save(path, quality=JPEG_QUALITY, subsampling=0)
    else:
        image.save(path)
