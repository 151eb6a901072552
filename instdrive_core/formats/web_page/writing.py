"""Writing a scene as one page: PlayCanvas's viewer, the splats as a .sog, and the ID of each of them.

The page fetches nothing: its policy forbids it. `content` says how the scene lies in it.
"""

from __future__ import annotations

import base64
import io
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.files.atomic import write_bytes
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.sog.writing import check_for_sog, pack_sog
from instdrive_core.formats.web_page.axes import FILE_FROM_SCENE, order_for_page, turn_point_for_viewer
from instdrive_core.formats.web_page.content import ABOUT, IDS, SPLATS, build_element, encode_about, encode_ids
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import transform_gaussians

VIEWER = "instdrive-viewer"
"""Id of the element that holds the viewer's script, gzip in base64."""
_ASSETS = Path(__file__).parent / "assets"
_TURNING_DISTANCE = 10.0
"""Metres ahead of the camera about which the view turns first."""
_BACKGROUND = (0.4, 0.4, 0.4)


def write_web_page(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment as a page, atomically; rows are put in spatial order.

    Raises DataError where `write_sog` does.
    """
    path = Path(path)
    check_for_sog(path, scene, ".html")
    order = order_for_page(scene.gaussians.means)
    gaussians = scene.gaussians.select(order)
    transform_gaussians(gaussians, FILE_FROM_SCENE)
    splats = _zip_files(pack_sog(gaussians, scene.antialiased))
    page = _build_page(splats, scene.instance_ids[order], _describe(scene))
    check_plausible_count(path, len(scene), len(page))
    write_bytes(path, page)


def _zip_files(files: dict[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_STORED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content)  # with a fixed date: equal scenes make equal pages
    return data.getvalue()


def _describe(scene: Scene) -> dict[str, Any]:
    instances = {
        str(entry.id): {"name": entry.name, "class": entry.class_name, "color": list(entry.color)}
        for entry in scene.table
    }
    camera = scene.start or next((view.camera for view in scene.views), None)
    return {
        "origin": scene.origin.tolist(),
        "instances": instances,
        "settings": _build_settings(None if camera is None else _place_camera(camera)),
    }


def _place_camera(camera: Camera) -> dict[str, Any]:
    forward = camera.world_from_camera[:3, 2]
    position = turn_point_for_viewer(camera.position)
    target = turn_point_for_viewer(camera.position + _TURNING_DISTANCE * forward)
    # The viewer takes the angle along the longer side of its window.
    fov = math.degrees(2 * math.atan(max(camera.width / camera.fx, camera.height / camera.fy) / 2))
    return {"position": position.tolist(), "target": target.tolist(), "fov": min(max(fov, 10.0), 120.0)}


def _build_settings(camera: dict[str, Any] | None) -> dict[str, Any]:
    """Build the viewer's settings; without a camera it frames the scene."""
    effects = {
        "sharpness": {"enabled": False, "amount": 0},
        "bloom": {"enabled": False, "intensity": 0.1, "blurLevel": 2},
        "grading": {"enabled": False, "brightness": 1, "contrast": 1, "saturation": 1, "tint": [1, 1, 1]},
        "vignette": {"enabled": False, "intensity": 0.5, "inner": 0.3, "outer": 0.75, "curvature": 1},
        "fringing": {"enabled": False, "intensity": 0.5},
    }
    return {
        "version": 2,
        "tonemapping": "none",
        "highPrecisionRendering": False,
        "background": {"color": list(_BACKGROUND)},
        "postEffectSettings": effects,
        "animTracks": [],
        "cameras": [] if camera is None else [{"initial": camera}],
        "annotations": [],
        "startMode": "default",
    }


def _build_page(splats: bytes, ids: ndarray, about: dict[str, Any]) -> bytes:
    filling = {
        "VIEWER_CSS": _read_asset("viewer.css"),
        "PAGE_CSS": _read_asset("page.css"),
        "PAGE_JS": _read_asset("page.js"),
        "ABOUT": build_element(ABOUT, encode_about(about)),
        "IDS": build_element(IDS, encode_ids(ids.astype(np.uint32))),
        "SPLATS": build_element(SPLATS, base64.b64encode(splats)),
        "VIEWER": build_element(VIEWER, base64.b64encode(_read_asset("viewer.js.gz"))),
        "LICENSES": _read_asset("LICENSES.txt"),
    }
    parts = _read_asset("page.html").split(b"@@")
    return b"".join(filling[part.decode()] if number % 2 else part for number, part in enumerate(parts))


def _read_asset(name: str) -> bytes:
    return (_ASSETS / name).read_bytes()
