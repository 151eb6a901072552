"""Pictures that requests ask for: which camera, drawn, and packed."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.rasterize.lens import LensRays, view_through_lens
from instdrive_core.rasterize.rolling_shutter import Direction, RollingCamera, view_through_shutter
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera
from instdrive_core.serving.lenses import trace_lens
from instdrive_core.serving.messages import name_enum_value
from instdrive_core.serving.requests import (
    FrameSpan,
    Limits,
    PosePair,
    RequestError,
    read_frame,
    read_pose_pair,
    require_between,
    require_pixels,
)
from instdrive_core.serving.stage import Stage

LEAST_SIDE = 8
"""Pixels that a picture is wide and high at least."""
_FOCAL = (1.0, 1e6)
_USUAL_QUALITY = 95.0
_DISTORTIONS = ("radial_coeffs", "tangential_coeffs", "thin_prism_coeffs")
_SHUTTERS: dict[str, Direction | None] = {
    "GLOBAL": None,
    "ROLLING_TOP_TO_BOTTOM": "down",
    "ROLLING_LEFT_TO_RIGHT": "right",
    "ROLLING_BOTTOM_TO_TOP": "up",
    "ROLLING_RIGHT_TO_LEFT": "left",
    "UNKNOWN": None,
}
_FORMATS = ("UNDEFINED", "PNG", "JPEG", "RGB_UINT8_PLANAR")


@dataclass(frozen=True)
class PictureOrder:
    """A picture as it is asked for, checked."""

    camera: Camera
    """At the middle of the frame."""
    poses: PosePair
    """At its start and its end."""
    rays: LensRays | None
    """Where its pixels look; None where they are the camera's."""
    direction: Direction | None
    """Which way the exposed line goes; None where all lines are exposed at the middle of the frame."""
    frame: FrameSpan
    format: str
    quality: int


def read_picture_order(request: Any, last: float, limits: Limits) -> PictureOrder:
    """Read what an RGBRenderRequest asks for.

    Args:
        request: its scene has been checked.
        last: end of the drive, seconds.
        limits: of sizes.

    Raises RequestError naming the field that is wrong.
    """
    frame = read_frame(request, last)
    if request.insert_ego_mask:
        raise RequestError("insert_ego_mask", "true", "send false: this server knows no ego masks")
    packing = name_enum_value("ImageFormat", request.image_format)
    if packing not in _FORMATS:
        raise RequestError("image_format", packing, f"send {', '.join(_FORMATS[1:])}")
    quality = request.image_quality or _USUAL_QUALITY
    require_between("image_quality", quality, 1, 100)
    poses = read_pose_pair("sensor_pose", request.sensor_pose)
    shutter = name_enum_value("ShutterType", request.camera_intrinsics.shutter_type)
    if shutter not in _SHUTTERS:
        raise RequestError("camera_intrinsics.shutter_type", shutter, f"send {', '.join(_SHUTTERS)}")
    camera, rays = _read_camera(request, poses, limits)
    if rays is not None and _SHUTTERS[shutter] is not None:
        remedy = "send GLOBAL, or opencv_pinhole_param without distortion: other lenses are drawn at one moment"
        raise RequestError("camera_intrinsics.shutter_type", shutter, remedy)
    return PictureOrder(camera, poses, rays, _SHUTTERS[shutter], frame, packing, round(quality))


def draw_ordered_picture(stage: Stage, request: Any, order: PictureOrder, limits: Limits) -> bytes:
    """Draw a picture, and pack it."""
    scene, frame = stage.place(request.dynamic_objects, order.frame, limits), order.frame
    if order.rays is not None:
        color = view_through_lens(scene, order.rays, order.camera.world_from_camera, frame.middle)
    elif order.direction is None:
        color = view_scene(scene, order.camera, frame.middle).color
    else:
        ends = order.poses.start, order.poses.end, frame.start, frame.end
        color = view_through_shutter(scene, RollingCamera(order.camera, *ends, order.direction)).color
    return _pack(np.round(np.clip(color, 0, 1) * 255).astype(np.uint8), order)


def _read_camera(request: Any, poses: PosePair, limits: Limits) -> tuple[Camera, LensRays | None]:
    """The camera, and where its pixels look if it is no pinhole: then only its size and pose mean something."""
    spec, field = request.camera_intrinsics, "camera_intrinsics"
    kind = spec.WhichOneof("camera_param")
    if kind is None:
        remedy = "send opencv_pinhole_param, opencv_fisheye_param or ftheta_param, such as get_available_cameras gives"
        raise RequestError(f"{field}.camera_param", "missing", remedy)
    if spec.HasField("bivariate_windshield_model_param"):
        raise RequestError(f"{field}.external_distortion", "a windshield", "leave it out: it is not drawn")
    width, height = spec.resolution_w, spec.resolution_h
    for name, value in (("resolution_w", width), ("resolution_h", height)):
        require_between(f"{field}.{name}", value, LEAST_SIDE, limits.side)
    asked = request.resolution_w or width, request.resolution_h or height
    for name, value in zip(("resolution_w", "resolution_h"), asked, strict=True):
        require_between(name, value, LEAST_SIDE, limits.side)
    require_pixels(asked[0] * asked[1], limits)
    lens = getattr(spec, kind)
    if kind != "opencv_pinhole_param" or any(any(getattr(lens, name)) for name in _DISTORTIONS):
        if asked[0] * asked[1] > limits.lens_pixels:
            remedy = f"a picture of this lens may have {limits.lens_pixels:,} pixels; ask for a smaller one"
            raise RequestError("resolution_w × resolution_h", f"{asked[0] * asked[1]:,} pixels", remedy)
        rays = trace_lens(spec, asked)
        return Camera(1.0, 1.0, asked[0] / 2, asked[1] / 2, *asked, poses.middle), rays
    lens_field = f"{field}.opencv_pinhole_param"
    fx = require_between(f"{lens_field}.focal_length_x", lens.focal_length_x, *_FOCAL)
    fy = require_between(f"{lens_field}.focal_length_y", lens.focal_length_y, *_FOCAL)
    cx = require_between(f"{lens_field}.principal_point_x", lens.principal_point_x, -width, 2 * width)
    cy = require_between(f"{lens_field}.principal_point_y", lens.principal_point_y, -height, 2 * height)
    camera = Camera(fx, fy, cx, cy, width, height, poses.middle)
    return (camera if asked == (width, height) else camera.resize(*asked)), None


def _pack(color: UInt8[ndarray, "h w 3"], order: PictureOrder) -> bytes:
    if order.format == "RGB_UINT8_PLANAR":
        return np.ascontiguousarray(color.transpose(2, 0, 1)).tobytes()
    packed = io.BytesIO()
    if order.format == "JPEG":
        Image.fromarray(color).save(packed, "JPEG", quality=order.quality)
    else:
        Image.fromarray(color).save(packed, "PNG", compress_level=1)
    return packed.getvalue()
