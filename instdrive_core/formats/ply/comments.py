"""Comment lines of a .ply for what columns cannot hold: instance names, classes, code bits and origin, as JSON.

How the splats are to be drawn stands there, too, as other programs write it: ``SplatRenderMode: mip`` (Brush, gsplat;
written) or ``antialiased 1`` (Postshot).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.json_value import parse_json, require_whole_text
from instdrive_core.formats.ply.start_view import VIEW, parse_view_comment
from instdrive_core.instances.codebook import MAX_BITS
from instdrive_core.instances.table import make_default_name
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene

_ANTIALIASED = "SplatRenderMode: mip"
_DRAWN_AS = {_ANTIALIASED: True, "SplatRenderMode: default": False, "antialiased 1": True, "antialiased 0": False}
"""Known comments, of which the last one counts."""
_SCENE, _INSTANCE = "instdrive scene ", "instdrive instance "


@dataclass
class Annotations:
    """What the comments of a .ply say."""

    antialiased: bool = False
    code_bits: int = 0
    origin: Float64[ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    names: dict[int, str] = field(default_factory=dict)
    classes: dict[int, str] = field(default_factory=dict)
    start: Camera | None = None
    has_sky: bool = False
    """Whether a picture of the sky was written beside the file."""


def build_comments(scene: Scene) -> list[str]:
    """Build a scene's comment lines: none without instances, codewords or origin, so that it stays a plain .ply."""
    lines = [_ANTIALIASED] if scene.antialiased else []
    if scene.code_bits or len(scene.table) or scene.origin.any():
        lines.append(_SCENE + _encode_line({"code_bits": scene.code_bits, "origin": scene.origin.tolist()}))
    for instance in scene.table:
        entry = {"id": instance.id, "name": instance.name, "class": instance.class_name}
        if instance.name != make_default_name(instance.id) or instance.class_name:
            lines.append(_INSTANCE + _encode_line(entry))
    return lines


def parse_comments(comments: tuple[str, ...], path: Path) -> Annotations:
    """Read the lines written by `build_comments`; others are passed over. Raises DataError where one is damaged."""
    annotations = Annotations()
    known = {_normalize_comment(text): antialiased for text, antialiased in _DRAWN_AS.items()}
    for comment in comments:
        annotations.antialiased = known.get(_normalize_comment(comment), annotations.antialiased)
        try:
            if comment.startswith(_SCENE):
                _parse_scene(parse_json(comment.removeprefix(_SCENE)), annotations)
            elif comment.startswith(_INSTANCE):
                entry = parse_json(comment.removeprefix(_INSTANCE))
                instance_id = int(entry["id"])
                annotations.names[instance_id] = require_whole_text(entry["name"])
                annotations.classes[instance_id] = require_whole_text(entry.get("class", ""))
            elif comment.startswith(VIEW):
                annotations.start = parse_view_comment(comment)
                annotations.has_sky = '"sky":' in comment
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            problem = f"the header comment {comment[:80]!r} is damaged ({type(error).__name__}: {error})"
            raise DataError(path, problem, "Remove that line from the header or export the file again") from error
    return annotations


def _parse_scene(entry: dict[str, Any], annotations: Annotations) -> None:
    bits, origin = int(entry["code_bits"]), np.array(entry["origin"], np.float64)
    if not 0 <= bits <= MAX_BITS or origin.shape != (3,) or not np.isfinite(origin).all():
        raise ValueError(f"code_bits {bits} or origin {entry['origin']} out of range")
    annotations.code_bits, annotations.origin = bits, origin


def _normalize_comment(comment: str) -> str:
    """Remove differences in case, spaces and the colon, in which programs do not agree."""
    return " ".join(comment.replace(":", " ").lower().split())


def _encode_line(entry: dict[str, Any]) -> str:
    return json.dumps(entry, ensure_ascii=True, separators=(",", ":"))
