"""A client of the server, with arrays instead of messages."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera
from instdrive_core.serving.messages import SERVICE, find_enum_value, find_message_class, list_methods, pack_message
from instdrive_core.serving.requests import write_pose
from instdrive_core.sweeps.rig import Rig

Pose = Float64[ndarray, "4 4"]


@dataclass(frozen=True)
class MountedCamera:
    """A camera of the drive; its pose is in the rig: x forward, y left, z up."""

    name: str
    camera: Camera

    def mount(self, world_from_rig: Pose) -> Camera:
        """Return the camera as the rig carries it."""
        return replace(self.camera, world_from_camera=world_from_rig @ self.camera.world_from_camera)


class SensorClient:
    """Asks a server for pictures and sweeps. Poses are 4 × 4 in the scene's world, times seconds of the drive.

    Args:
        address: e.g. ``127.0.0.1:50051``.
        timeout: seconds to wait for an answer.
    """

    def __init__(self, address: str, timeout: float = 60.0) -> None:
        import grpc

        options = [("grpc.max_receive_message_length", -1), ("grpc.enable_http_proxy", 0)]
        self._channel, self._timeout = grpc.insecure_channel(address, options=options), timeout

    def __enter__(self) -> SensorClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up."""
        self._channel.close()

    def call(self, method: str, request: Any) -> Any:
        """Send a message, and return the answer. Raises grpc.RpcError, whose details say what is wrong."""
        kind = list_methods()[method][1]
        send = self._channel.unary_unary(f"/{SERVICE}/{method}", pack_message, kind.FromString)
        return send(request, timeout=self._timeout, wait_for_ready=True)

    def list_cameras(self) -> tuple[MountedCamera, ...]:
        """List the drive's cameras."""
        found = self.call("get_available_cameras", find_message_class("AvailableCamerasRequest")())
        return tuple(_read_camera(each) for each in found.available_cameras)

    def fetch_way(self) -> Rig:
        """Fetch the way that the car took."""
        found = self.call("get_available_trajectories", find_message_class("AvailableTrajectoriesRequest")())
        poses = found.available_trajectories[0].trajectory.poses
        times = np.array([each.timestamp_us / 1e6 for each in poses])
        return Rig(times, np.stack([_read_pose(each.pose) for each in poses]))

    def draw(self, camera: Camera, time: float, objects: Mapping[str, Pose] | None = None) -> UInt8[ndarray, "h w 3"]:
        """Draw a picture.

        Args:
            camera: in the world.
            time: seconds of the drive.
            objects: poses of things by ID: of the boxes' centres, x forward, y left, z up.
        """
        return self.draw_rig([MountedCamera("camera", camera)], np.eye(4), time, objects)["camera"]

    def draw_rig(
        self,
        cameras: list[MountedCamera],
        world_from_rig: Pose,
        time: float,
        objects: Mapping[str, Pose] | None = None,
    ) -> dict[str, UInt8[ndarray, "h w 3"]]:
        """Draw the pictures of several cameras on a rig, by the cameras' names; other arguments as `draw` has them."""
        item = find_message_class("BatchRGBRenderRequestItem")
        items = [
            item(camera_name=each.name, request=build_picture_request(each.mount(world_from_rig), time, objects))
            for each in cameras
        ]
        found = self.call("batch_render_rgb", find_message_class("BatchRGBRenderRequest")(items=items))
        return {each.camera_name: _unpack(each.result.image_bytes) for each in found.items}

    def sweep(
        self,
        start: tuple[float, Pose],
        end: tuple[float, Pose],
        objects: Mapping[str, Pose] | None = None,
    ) -> tuple[Float32[ndarray, "n 3"], Float32[ndarray, " n"]]:
        """Cast a sweep: points in the sensor's axes at its end (x forward, y left, z up), and their intensities.

        Args:
            start: when the turn begins (seconds), and where the sensor is then.
            end: the same of its end.
            objects: as `draw` has them.
        """
        request = find_message_class("LidarRenderRequest")(
            frame_start_us=round(start[0] * 1e6),
            frame_end_us=round(end[0] * 1e6),
            sensor_pose=_pair(start[1], end[1]),
            dynamic_objects=_place(objects),
        )
        found = self.call("render_lidar", request)
        points = np.frombuffer(found.point_xyzs_buffer, "<f4").reshape(-1, 3)
        return points.astype(np.float32), np.frombuffer(found.point_intensities_buffer, "<f4").astype(np.float32)


def build_picture_request(camera: Camera, time: float, objects: Mapping[str, Pose] | None = None) -> Any:
    """Build the message that asks for a picture; arguments as `SensorClient.draw` has them."""
    lens = find_message_class("OpenCVPinholeCameraParam")(
        principal_point_x=camera.cx,
        principal_point_y=camera.cy,
        focal_length_x=camera.fx,
        focal_length_y=camera.fy,
    )
    return find_message_class("RGBRenderRequest")(
        resolution_h=camera.height,
        resolution_w=camera.width,
        camera_intrinsics=find_message_class("CameraSpec")(
            opencv_pinhole_param=lens, resolution_h=camera.height, resolution_w=camera.width
        ),
        frame_start_us=round(time * 1e6),
        frame_end_us=round(time * 1e6),
        sensor_pose=_pair(camera.world_from_camera, camera.world_from_camera),
        dynamic_objects=_place(objects),
        image_format=find_enum_value("ImageFormat", "PNG"),
    )


def _place(objects: Mapping[str, Pose] | None) -> list[Any]:
    message = find_message_class("DynamicObject")
    return [message(track_id=name, pose_pair=_pair(pose, pose)) for name, pose in (objects or {}).items()]


def _pair(start: Pose, end: Pose) -> Any:
    return find_message_class("PosePair")(start_pose=write_pose(start), end_pose=write_pose(end))


def _read_pose(message: Any) -> Pose:
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(
        np.array([message.quat.w, message.quat.x, message.quat.y, message.quat.z], np.float64)
    )
    pose[:3, 3] = message.vec.x, message.vec.y, message.vec.z
    return pose


def _read_camera(message: Any) -> MountedCamera:
    spec = message.intrinsics
    lens = spec.opencv_pinhole_param
    focal, center = (lens.focal_length_x, lens.focal_length_y), (lens.principal_point_x, lens.principal_point_y)
    camera = Camera(*focal, *center, spec.resolution_w, spec.resolution_h, _read_pose(message.rig_to_camera))
    return MountedCamera(message.logical_id, camera)


def _unpack(packed: bytes) -> UInt8[ndarray, "h w 3"]:
    with Image.open(io.BytesIO(packed)) as picture:
        return np.asarray(picture.convert("RGB"))
