"""What a bundle is made of: names of its members, schemas, and the frames that it declares.

The layout is that of `3dgs_io <https://github.com/autowarefoundation/3dgs_io>`_, which splatsim reads: ``scene.json``
(v3 lists the chunks, v2 leaves them to be found), ``chunks/*.spz`` in the world's axes as they are,
``sequence_tracks.json``, and ``actor_assets.json`` with a ``.spz`` for each body in its own axes.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

SCENE, STAGE, IDENTITY = "scene.json", "default.usda", "metadata.yaml"
TRACKS, ASSETS = "sequence_tracks.json", "actor_assets.json"
CHUNKS = "chunks/"
SCENE_SCHEMAS = ("splatsim.scene/v2", "splatsim.scene/v3")
"""The last one is written."""
TRACKS_SCHEMA, ASSETS_SCHEMA = "splatsim.sequence_tracks/v2", "splatsim.actor_assets/v1"
OWN_DATA = "instdrive"
"""Key of what only this program reads: other readers pass it over."""
REMEDY = "Copy the bundle again, or export it again"
MOST_MEMBERS = 100_000
FRAMES: dict[str, Any] = {
    "world": {"handedness": "right", "up_axis": "z", "type": "ENU"},
    "rig": {"forward": "+x", "left": "+y", "up": "+z", "origin": "ground_under_rear_axle"},
    "camera": {"model_axes": "opencv_+z_forward"},
    "lidar": {"axes": "+x_forward_+y_left_+z_up"},
    "quaternion_order": "xyzw",
    "matrix_layout": "row_major",
    "vector_convention": "column_vector_child_to_parent",
    "length_units": "meters",
    "time_units": "microseconds",
}
"""The one convention that readers of bundles accept."""
OBJECT_FRAME: dict[str, Any] = {
    "handedness": "right",
    "forward": "+x",
    "left": "+y",
    "up": "+z",
    "origin": "bbox_center",
    "quaternion_order": "xyzw",
    "length_units": "meters",
    "scale": "metric",
}
"""The one convention of bodies."""


def is_bundle(path: Path) -> bool:
    """Whether a file is a zip archive with a ``scene.json``; a stage of OpenUSD has none."""
    try:
        with zipfile.ZipFile(path) as archive:
            return SCENE in archive.NameToInfo
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return False
