"""What the server answers: a method per call of AlpaSim's SensorsimService, without the network."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.masks.export.id_maps import choose_views
from instdrive_core.recording.drive import open_drive
from instdrive_core.recording.plan import RecordOptions, plan_camera_views
from instdrive_core.recording.things import find_boxed_things
from instdrive_core.scene.camera import CameraView
from instdrive_core.serving.client import build_picture_request
from instdrive_core.serving.messages import find_enum_value, find_message_class
from instdrive_core.serving.pictures import draw_ordered_picture, read_picture_order
from instdrive_core.serving.requests import USUAL_LIMITS, Limits, Rate, RequestError, require_pixels, write_pose
from instdrive_core.serving.stage import Stage, Unnamed, build_stage
from instdrive_core.serving.sweeps import AS_ASKED, ServedLidar
from instdrive_core.sweeps.rig import Rig, build_rig

_ANY_SCENE = ("", "*")
"""What a request may say that does not care which scene it is."""


@dataclass(frozen=True)
class SensorService:
    """Answers requests about one drive. Each method takes the message that its call takes, and raises RequestError."""

    name: str
    stage: Stage
    lidar: ServedLidar
    rig: Rig
    views: tuple[CameraView, ...]
    """Views of the cameras that are listed, at all moments."""
    last: float
    """End of the drive, seconds."""
    limits: Limits = USUAL_LIMITS
    rate: Rate = field(default_factory=lambda: Rate(USUAL_LIMITS))
    """What is left of the pixels and rays that may be asked for by now."""

    def with_limits(self, limits: Limits) -> SensorService:
        """Return the same service with other limits."""
        return replace(self, limits=limits, rate=Rate(limits))

    def warm_up(self) -> None:
        """Draw and cast once, so that the first request does not wait for what is compiled."""
        first, pose = self.views[0], write_pose(self.rig.world_from_rig[0])
        camera = first.camera.resize(64, 64)
        self.render_rgb(build_picture_request(camera, max(first.time, 0.0)))
        pair = find_message_class("PosePair")(start_pose=pose, end_pose=pose)
        self.render_lidar(find_message_class("LidarRenderRequest")(sensor_pose=pair))

    def render_rgb(self, request: Any) -> Any:
        """Draw a camera's picture."""
        return self._draw([request])[0]

    def batch_render_rgb(self, request: Any) -> Any:
        """Draw several cameras' pictures; all are drawn, or the request is refused."""
        self._check_count("items", len(request.items))
        item = find_message_class("BatchRGBRenderReturnItem")
        drawn = self._draw([each.request for each in request.items])
        items = zip(request.items, drawn, strict=True)
        return find_message_class("BatchRGBRenderReturn")(
            items=[item(camera_name=each.camera_name, result=result, success=True) for each, result in items]
        )

    def render_lidar(self, request: Any) -> Any:
        """Cast a sweep."""
        self._check_scene(request.scene_id)
        return self.lidar.cast(self.stage, request, self.last, self.limits, self.rate)

    def render_aggregated(self, request: Any) -> Any:
        """Draw pictures and cast sweeps."""
        self._check_count("rgb_requests and lidar_requests", len(request.rgb_requests) + len(request.lidar_requests))
        return find_message_class("AggregatedRenderReturn")(
            rgb_returns=self._draw(list(request.rgb_requests)),
            lidar_returns=[self.render_lidar(each) for each in request.lidar_requests],
        )

    def get_version(self, _: Any) -> Any:
        """Say which program this is."""
        return find_message_class("VersionId")(version_id=f"instdrive {version('instdrive')}")

    def get_available_scenes(self, _: Any) -> Any:
        """Name the one scene."""
        return find_message_class("AvailableScenesReturn")(scene_ids=[self.name])

    def get_loaded_scenes(self, _: Any) -> Any:
        """Name the one scene, which stays loaded."""
        entry = find_message_class("LoadedSceneEntry")(
            scene_id=self.name, loaded_instance_count=1, reusable_instance_count=1
        )
        return find_message_class("LoadedScenesReturn")(scenes=[entry], loaded_instance_capacity=1)

    def get_available_cameras(self, request: Any) -> Any:
        """List the drive's own cameras, and where they sit in the rig."""
        self._check_scene(request.scene_id)
        return find_message_class("AvailableCamerasReturn")(available_cameras=self._describe_cameras())

    def get_available_trajectories(self, request: Any) -> Any:
        """Give the rig's own way through the drive."""
        self._check_scene(request.scene_id)
        at = find_message_class("PoseAtTime")
        poses = [
            at(pose=write_pose(pose), timestamp_us=round(time * 1e6))
            for time, pose in zip(self.rig.times.tolist(), self.rig.world_from_rig, strict=True)
            if time >= 0
        ]
        way = find_message_class("Trajectory")(poses=poses)
        trajectory = find_message_class("AvailableTrajectoriesReturn.AvailableTrajectory")(trajectory=way)
        return find_message_class("AvailableTrajectoriesReturn")(available_trajectories=[trajectory])

    def get_available_ego_masks(self, _: Any) -> Any:
        """List ego masks: there are none."""
        return find_message_class("AvailableEgoMasksReturn")()

    def _draw(self, requests: list[Any]) -> list[Any]:
        """Pictures of requests, none before all are checked."""
        orders, pixels = [], 0
        for request in requests:
            self._check_scene(request.scene_id)
            orders.append(read_picture_order(request, self.last, self.limits))
            pixels += orders[-1].camera.width * orders[-1].camera.height
            require_pixels(pixels, self.limits)
        self.rate.take(pixels)
        answer = find_message_class("RGBRenderReturn")
        pairs = zip(requests, orders, strict=True)
        return [answer(image_bytes=draw_ordered_picture(self.stage, each, order, self.limits)) for each, order in pairs]

    def _check_count(self, field: str, count: int) -> None:
        if count > self.limits.pictures:
            raise RequestError(field, f"{count} long", f"send at most {self.limits.pictures}")

    def _check_scene(self, name: str) -> None:
        if name not in (self.name, *_ANY_SCENE):
            raise RequestError("scene_id", repr(name), f"send {self.name!r}, the scene that is served")

    def _describe_cameras(self) -> list[Any]:
        described, seen = [], set[str]()
        spec, lens = find_message_class("CameraSpec"), find_message_class("OpenCVPinholeCameraParam")
        for view in self.views:
            if view.name in seen:
                continue
            seen.add(view.name)
            camera, world_from_rig = view.camera, np.eye(4)
            places, turns = self.rig.place(np.array([view.time]))
            world_from_rig[:3, :3], world_from_rig[:3, 3] = turns[0], places[0]
            intrinsics = spec(
                opencv_pinhole_param=lens(
                    principal_point_x=camera.cx,
                    principal_point_y=camera.cy,
                    focal_length_x=camera.fx,
                    focal_length_y=camera.fy,
                ),
                logical_id=view.name,
                resolution_h=camera.height,
                resolution_w=camera.width,
                shutter_type=find_enum_value("ShutterType", "GLOBAL"),
            )
            described.append(
                find_message_class("AvailableCamerasReturn.AvailableCamera")(
                    intrinsics=intrinsics,
                    rig_to_camera=write_pose(np.linalg.inv(world_from_rig) @ camera.world_from_camera),
                    logical_id=view.name,
                )
            )
        return described


def open_sensor_service(
    path: Path,
    lidar: str | None = None,
    unnamed: Unnamed = "drive",
    limits: Limits = USUAL_LIMITS,
    cameras: Path | None = None,
    ray_drop: bool = False,
) -> tuple[SensorService, tuple[str, ...]]:
    """Open a run, a scene folder or a project to be served; also what the user should know.

    Args:
        path: its name without ending is the scene's name.
        lidar: which sensor is cast: `own`, one of `sweeps.sensor.SENSORS`, or a JSON file; None is the one that
            requests name by themselves, PANDAR128.
        unnamed: what moving things do that a request does not name.
        limits: what one client may cost.
        cameras: JSON file of the cameras that are listed; None: the drive's own.
        ray_drop: whether surfaces lose rays as often as in the sweeps of the run's clip.

    Raises DataError, SceneTooLargeError and OptionError as opening a drive does.
    """
    options = RecordOptions(lidar=lidar or AS_ASKED, rig=cameras, ray_drop=ray_drop)
    drive = open_drive(path, options)
    assert drive.lidar is not None
    views = choose_views(drive.scene)
    stage = build_stage(drive.scene, find_boxed_things(drive.scene, drive.moves, drive.annotated), unnamed)
    ends = [view.time for view in views] + [float(track.times[-1]) for track in drive.scene.actors]
    name = path.resolve().stem or "scene"
    served = ServedLidar(drive.lidar, lidar is not None)
    listed = plan_camera_views(drive.scene, options)
    return SensorService(name, stage, served, build_rig(views), listed, max(ends), limits, Rate(limits)), drive.notes
