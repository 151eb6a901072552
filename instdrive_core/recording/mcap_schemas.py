"""JSON schemas of the Foxglove messages that a recording is written as (docs.foxglove.dev, message schemas)."""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]


def _object(**properties: Schema) -> Schema:
    return {"type": "object", "properties": properties}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_NUMBER, _WHOLE, _TEXT, _SWITCH = ({"type": name} for name in ("number", "integer", "string", "boolean"))
_BYTES = {"type": "string", "contentEncoding": "base64"}
_TIME = _object(sec=_WHOLE, nsec=_WHOLE) | {"title": "time"}
_DURATION = _object(sec=_WHOLE, nsec=_WHOLE) | {"title": "duration"}
_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_TURN = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_VECTOR, orientation=_TURN)
_COLOR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_CUBE = _object(pose=_POSE, size=_VECTOR, color=_COLOR)
_ENTITY = _object(
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked=_SWITCH,
    metadata=_list(_object(key=_TEXT, value=_TEXT)),
    arrows=_list(_object()),
    cubes=_list(_CUBE),
    spheres=_list(_object()),
    cylinders=_list(_object()),
    lines=_list(_object()),
    triangles=_list(_object()),
    texts=_list(_object()),
    models=_list(_object()),
)
SCHEMAS: dict[str, Schema] = {
    "foxglove.FrameTransform": _object(
        timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR, rotation=_TURN
    ),
    "foxglove.CompressedImage": _object(timestamp=_TIME, frame_id=_TEXT, data=_BYTES, format=_TEXT),
    "foxglove.CameraCalibration": _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        width=_WHOLE,
        height=_WHOLE,
        distortion_model=_TEXT,
        D=_list(_NUMBER),
        K=_list(_NUMBER),
        R=_list(_NUMBER),
        P=_list(_NUMBER),
    ),
    "foxglove.SceneUpdate": _object(
        deletions=_list(_object(timestamp=_TIME, type=_WHOLE, id=_TEXT)), entities=_list(_ENTITY)
    ),
    "foxglove.PointCloud": _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_POSE,
        point_stride=_WHOLE,
        fields=_list(_object(name=_TEXT, offset=_WHOLE, type=_WHOLE)),
        data=_BYTES,
    ),
}
"""By the name of the message."""
FLOAT32, UINT32 = 7, 5
"""Numbers of types of a point cloud's fields."""
