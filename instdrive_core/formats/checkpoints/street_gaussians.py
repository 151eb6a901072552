"""StreetGaussians' ``trained_model/iteration_N.pth``: background, moving objects and a sky.

Layout (Yan et al. 2024, ``lib/models``): ``{"background": state, "obj_003": state, …, "actor_pose", "sky_cubemap",
"iter"}``, states with ``xyz, feature_dc, feature_rest, scaling, rotation, opacity, semantic``. An object's constant
colour is a short Fourier series over its frames, ``feature_dc`` (n, f, 3). The file holds no tracks, only their
corrections; `actors.street_tracks` says where they are found.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.actors.street_scene import (
    STREET_BACKGROUND,
    assemble_street,
    sort_street_parts,
    weigh_waves,
)
from instdrive_core.formats.actors.street_tracks import STREET_OBJECT, find_street_tracks
from instdrive_core.formats.allocation import ReadOptions
from instdrive_core.formats.checkpoints.cube_texture import read_cube_sky
from instdrive_core.formats.checkpoints.splat_part import REMEDY, FieldNames, read_parts, view_part
from instdrive_core.scene.scene import Scene

_FIELDS = FieldNames("xyz", "rotation", "scaling", "opacity", "feature_dc", "feature_rest")
_MOST_OBJECTS = 10_000


def find_street(file: TorchCheckpoint) -> Mapping[Any, Any] | None:
    """The states of StreetGaussians' models by name; None where it is another checkpoint."""
    items = file.find_items(file.content)
    return items if items is not None and "xyz" in (file.find_items(items.get(STREET_BACKGROUND)) or {}) else None


def read_street(file: TorchCheckpoint, models: Mapping[Any, Any], options: ReadOptions) -> Scene:
    """Read the background, the objects with the tracks that are found, and the sky. Raises DataError."""
    left_out: list[str] = []
    objects = [name for name in models if isinstance(name, str) and STREET_OBJECT.fullmatch(name)]
    if len(objects) > _MOST_OBJECTS:
        raise DataError(file.path, f"it has {len(objects)} objects, more than {_MOST_OBJECTS}", REMEDY)
    tracks = find_street_tracks(file.path, objects, options.data, left_out)
    names = sort_street_parts([STREET_BACKGROUND, *objects], tracks)
    parts = [view_part(file, file.find_items(models[name]) or {}, _FIELDS, name) for name in names]
    gaussians, places = read_parts(file.path, parts, options)
    start, changing = 0, False
    for name, part, rows in zip(names, parts, places, strict=True):
        if name != STREET_BACKGROUND and len(part.sh_dc.shape) == 3 and part.sh_dc.shape[1] > 1:
            changing = True
            series = part.sh_dc.read()[-start % options.keep_every :: options.keep_every]
            weights = weigh_waves(tracks.get(name), options.time, series.shape[1])
            gaussians.sh_dc[rows] = np.einsum("nfc,f->nc", series, weights)
        start += len(part)
    if changing:
        left_out.append("how the objects' colours change: all have those of one frame")
    if any(name in models for name in ("color_correction", "pose_correction")):
        left_out.append("corrections of colours or cameras per photo, as the checkpoint does not hold the cameras")
    sky = None
    if "sky_cubemap" in models:
        parameters = file.find_items((file.find_items(models["sky_cubemap"]) or {}).get("params")) or {}
        sky = read_cube_sky(file, parameters.get("sky_cube_map"), np.eye(3), left_out)
    return assemble_street(gaussians, dict(zip(names, places, strict=True)), tracks, options.time, sky, left_out)
