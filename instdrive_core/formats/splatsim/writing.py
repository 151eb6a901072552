"""Writing a bundle: the street in chunks, one instance or 50 m of ground each, and a body for each moving thing."""

from __future__ import annotations

import hashlib
import json
import uuid
import zipfile
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X
from instdrive_core.formats.export_checks import check_numbers
from instdrive_core.formats.instance_parts import InstancePart
from instdrive_core.formats.splatsim.assets import Body, Standing, describe_assets, get_asset_member, name_body
from instdrive_core.formats.splatsim.layout import (
    ASSETS,
    CHUNKS,
    FRAMES,
    IDENTITY,
    OWN_DATA,
    SCENE,
    SCENE_SCHEMAS,
    STAGE,
    TRACKS,
)
from instdrive_core.formats.splatsim.tracks import describe_tracks_of_bundle, get_length_width_height
from instdrive_core.formats.spz.axes import RDF
from instdrive_core.formats.spz.scenes import encode_spz
from instdrive_core.instances.table import Instance
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import transform_gaussians

_CELL = 50.0
"""Metres of ground in a chunk; splatsim's own exporter does the same."""
_MOST_SPLATS = 200_000
_ALIGNMENT = 64
"""Members of a USDZ begin at multiples of so many bytes."""
_OBJECT_FROM_BOX = np.c_[BOX_FROM_FORWARD_X.T, np.zeros(3)]
_PADDING = 0x1986
"""Kind of a member's extra field that readers pass over."""
_MEMBER_HEADER = 30
_STAGE_TEXT = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "World"
{
    custom asset sceneIndex = @./scene.json@
}
"""


def write_bundle(path: str | Path, scene: Scene) -> None:
    """Write a scene with its moving things, atomically; equal scenes give equal files.

    Raises DataError where the scene has no splats or values that are no numbers.
    """
    path = Path(path)
    if not len(scene):
        raise DataError(path, "the scene has no splats", "Save as .ply instead")
    check_numbers(path, "means", scene.gaussians.means, np.arange(len(scene)))
    with open_atomically(path) as out, zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        bundle = _Bundle(path, archive, out)
        bundle.add(STAGE, _STAGE_TEXT.encode())
        order, groups = _group_rows(scene)
        index, standing, bounds = [], [], {}
        taken: set[str] = set()
        for number, rows in enumerate(groups):
            part = scene.gaussians.select(order[rows])
            node = int(scene.nodes[order[rows.start]])
            if node:
                body = _make_body(scene, order[rows], node, taken, part.sh_degree)
                standing.append(Standing(scene.actors[node - 1].id, body))
                transform_gaussians(part, _OBJECT_FROM_BOX)
                bounds[body.id] = np.stack([part.means.min(axis=0), part.means.max(axis=0)]).astype(np.float64)
                bundle.add_splats(body.uri, part, scene.antialiased)
            else:
                name = f"{CHUNKS}chunk_{number:06d}.spz"
                index.append(_describe_chunk(name, part, _find_instance(scene, order[rows])))
                bundle.add_splats(name, part, scene.antialiased)
            report((number + 1) / (len(groups) + 1))
        if standing:
            present = {each.track for each in standing}
            tracks = [track for track in scene.actors if track.id in present]
            bundle.add_json(TRACKS, describe_tracks_of_bundle(tracks))
            bundle.add_json(ASSETS, describe_assets(standing, bounds))
        bundle.add_json(SCENE, _describe_scene(scene, index, bool(standing)))
        bundle.add_json(IDENTITY, bundle.identify())


def order_for_bundle(scene: Scene) -> Int64[ndarray, " n"]:
    """Order rows as they are written: the street by instance and place, then one moving thing after the other."""
    return _group_rows(scene)[0]


@dataclass
class _Bundle:
    path: Path
    archive: zipfile.ZipFile
    out: IO[bytes]
    content: Any = field(default_factory=hashlib.sha256)

    def add(self, name: str, data: bytes) -> None:
        """Add a member, its data aligned as USDZ wants it, at no time."""
        info = zipfile.ZipInfo(name)
        start = self.out.tell() + _MEMBER_HEADER + len(name.encode()) + 4
        gap = -start % _ALIGNMENT
        info.extra = _PADDING.to_bytes(2, "little") + gap.to_bytes(2, "little") + bytes(gap)
        self.archive.writestr(info, data)
        self.content.update(name.encode() + data)

    def add_json(self, name: str, content: Any) -> None:
        """Add a document."""
        self.add(name, json.dumps(content, indent=1).encode())

    def add_splats(self, name: str, part: Gaussians, antialiased: bool) -> None:
        """Add splats in the axes that they are in."""
        file = BytesIO()
        encode_spz(file, self.path, part, antialiased, axes=RDF)
        self.add(name, file.getvalue())

    def identify(self) -> dict[str, str]:
        """Identify the bundle by what it holds."""
        found = uuid.UUID(bytes=self.content.digest()[:16])
        return {"uuid": str(found), "scene_id": f"scene-{found.hex[:8]}", "version_string": "instdrive"}


def _group_rows(scene: Scene) -> tuple[Int64[ndarray, " n"], list[slice]]:
    """The order of the rows, and the slices of it that are written together."""
    still = scene.nodes == 0
    ids = np.where(still, scene.instance_ids, 0).astype(np.int64)
    cells = np.where((still & (ids == 0))[:, None], np.floor(scene.gaussians.means[:, :2] / _CELL), 0).astype(np.int64)
    keys = (cells[:, 0], cells[:, 1], ids, scene.nodes.astype(np.int64))
    order = np.lexsort(keys)
    changed = np.any([np.diff(key[order]) != 0 for key in keys], axis=0)
    starts = np.flatnonzero(np.r_[True, changed]).tolist()
    groups = []
    for start, stop in zip(starts, [*starts[1:], len(order)], strict=True):
        # A body is one file, however large.
        step = stop - start if scene.nodes[order[start]] else _MOST_SPLATS
        groups += [slice(first, min(first + step, stop)) for first in range(start, stop, step)]
    return order, groups


def _find_instance(scene: Scene, rows: Int64[ndarray, " k"]) -> Instance | None:
    """The instance that most of these rows belong to; None where it is the background."""
    ids, counts = np.unique(scene.instance_ids[rows], return_counts=True)
    number = int(ids[counts.argmax()])
    return scene.table.instances.get(number, Instance(number, f"instance {number}")) if number else None


def _make_body(scene: Scene, rows: Int64[ndarray, " k"], node: int, taken: set[str], degree: int) -> Body:
    track = scene.actors[node - 1]
    name = name_body(f"{track.label or 'object'}_{track.id}", taken)
    instance = _find_instance(scene, rows)
    own = InstancePart(slice(0, len(rows)), name, instance).describe() if instance else {}
    size = np.array(get_length_width_height(track))
    return Body(name, get_asset_member(name), track.label or "object", size, len(rows), degree, own)


def _describe_chunk(name: str, part: Gaussians, instance: Instance | None) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "uri": name,
        "n_points": len(part),
        "bbox_min": part.means.min(axis=0).tolist(),
        "bbox_max": part.means.max(axis=0).tolist(),
    }
    if instance is not None:
        entry[OWN_DATA] = InstancePart(slice(0, len(part)), instance.name, instance).describe()
    return entry


def _describe_scene(scene: Scene, index: list[dict[str, Any]], has_actors: bool) -> dict[str, Any]:
    return {
        "schema": SCENE_SCHEMAS[-1],
        "producer": {"tool": "instdrive"},
        "world": {"frame_convention": FRAMES, "ecef_anchor": np.eye(4).tolist()},
        "gaussians": {
            "frame": "world",
            "chunk_format": "spz/ngsp-v4",
            "chunks": index,
            "n_gaussians": sum(entry["n_points"] for entry in index),
            "sh_degree": scene.gaussians.sh_degree,
        },
        "extras": {"sequence_tracks": TRACKS, "actor_assets": ASSETS} if has_actors else {},
        OWN_DATA: {"origin": scene.origin.tolist(), "code_bits": scene.code_bits},
    }
