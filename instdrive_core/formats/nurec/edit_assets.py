"""``edit-assets.json``: actors that NuRec's renderer leaves out, exchanges or adds.

Layout (NVIDIA's NuRec, ``export-external-assets`` and ``render-grpc --edit-assets``): ``remove`` lists IDs of tracks,
``replace`` has ``original_id``, ``replacement_id`` and maybe ``object_size``, ``insert`` has ``asset_ids`` and, in
``data``, a track for each of them as in ``sequence_tracks.json``; ``metadata`` lists the packed assets. All four must
be there, even if empty.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.formats.nurec.sequence_tracks import describe_tracks, parse_sequence_tracks, read_text_file
from instdrive_core.scene.track import Track

NAME = "edit-assets.json"
Size = tuple[float, float, float]
_REMEDY = "Write the file again by NuRec's export-external-assets or by InstDrive"
_MOST = 65_000


@dataclass(frozen=True)
class AssetFacts:
    """What is said of an object that lies in ``external_assets``."""

    id: str
    label: str
    size: Size
    """Length, width, height in metres."""


@dataclass(frozen=True)
class Replacement:
    """An actor that is shown as an asset."""

    original: str
    """ID of its track."""
    asset: str
    size: Size | None = None
    """Length, width, height in metres; None = those of the asset."""


@dataclass(frozen=True)
class AssetEdits:
    """Edits of the actors of a reconstruction."""

    removed: tuple[str, ...] = ()
    """IDs of tracks."""
    replaced: tuple[Replacement, ...] = ()
    inserted: tuple[tuple[str, Track], ...] = ()
    """An asset's ID, or the path of a .ply, and the new track that shows it; seconds since `start`."""
    assets: tuple[AssetFacts, ...] = ()
    start: int = 0
    """Microseconds of the tracks' second 0."""


def write_asset_edits(path: Path, edits: AssetEdits, package: str = "") -> None:
    """Write the edits, atomically; `package` is the .usdz that holds the assets, where it is known."""
    content = {
        "metadata": {
            "output_artifact_path": package,
            "external_assets_metadata": [
                {"track_id": asset.id, "label_class": asset.label, "cuboid_dims": list(asset.size)}
                for asset in edits.assets
            ],
        },
        "replace": [
            {"original_id": one.original, "replacement_id": one.asset, "object_size": list(one.size or ())}
            for one in edits.replaced
        ],
        "remove": list(edits.removed),
        "insert": {
            "asset_ids": [asset for asset, _ in edits.inserted],
            "data": describe_tracks([track for _, track in edits.inserted], edits.start) if edits.inserted else {},
        },
    }
    with open_atomically(Path(path)) as out:
        out.write(json.dumps(content, indent=1).encode())


def read_asset_edits(path: Path) -> AssetEdits:
    """Read the edits. Raises DataError naming the field that cannot be used."""
    path = Path(path)
    text = read_text_file(path)
    try:
        content = parse_bounded_json(text)
    except ValueError as error:
        raise DataError(path, f"it is no JSON ({error})", _REMEDY) from error
    metadata, insert = (_require(path, content, name, dict) for name in ("metadata", "insert"))
    removed, replaced = (_require(path, content, name, list) for name in ("remove", "replace"))
    listed = metadata.get("external_assets_metadata", [])
    if not isinstance(listed, list) or max(map(len, (removed, replaced, listed))) > _MOST:
        raise DataError(path, f"external_assets_metadata is no list, or one of more than {_MOST} entries", _REMEDY)
    asset_ids = _require(path, insert, "asset_ids", list, "insert.")
    data = _require(path, insert, "data", dict, "insert.")
    found = parse_sequence_tracks(path, data) if data else None
    tracks = found.tracks if found else ()
    if len(asset_ids) != len(tracks):
        problem = f"insert.asset_ids has {len(asset_ids)} entries, insert.data {len(tracks)} tracks"
        raise DataError(path, problem, _REMEDY)
    names = [_require_id(path, value, f"insert.asset_ids[{row}]") for row, value in enumerate(asset_ids)]
    return AssetEdits(
        removed=tuple(_require_id(path, value, f"remove[{row}]") for row, value in enumerate(removed)),
        replaced=tuple(_read_replacement(path, entry, row) for row, entry in enumerate(replaced)),
        inserted=tuple(zip(names, tracks, strict=True)),
        assets=tuple(_read_facts(path, entry, row) for row, entry in enumerate(listed)),
        start=found.start if found else 0,
    )


def _read_replacement(path: Path, entry: Any, row: int) -> Replacement:
    where = f"replace[{row}]."
    if not isinstance(entry, dict):
        raise DataError(path, f"replace[{row}] is no object", _REMEDY)
    size = entry.get("object_size") or None
    return Replacement(
        _require_id(path, entry.get("original_id"), f"{where}original_id"),
        _require_id(path, entry.get("replacement_id"), f"{where}replacement_id"),
        None if size is None else _require_size(path, size, f"{where}object_size"),
    )


def _read_facts(path: Path, entry: Any, row: int) -> AssetFacts:
    where = f"metadata.external_assets_metadata[{row}]"
    if not isinstance(entry, dict):
        raise DataError(path, f"{where} is no object", _REMEDY)
    name = _require_id(path, entry.get("track_id"), f"{where}.track_id")
    size = _require_size(path, entry.get("cuboid_dims", entry.get("cuboids_dims")), f"{where}.cuboid_dims")
    return AssetFacts(name, str(entry.get("label_class", ""))[:200], size)


def _require(path: Path, holder: Any, name: str, kind: type, where: str = "") -> Any:
    value = holder.get(name) if isinstance(holder, dict) else None
    if not isinstance(value, kind):
        raise DataError(path, f"{where}{name} is missing or no {'object' if kind is dict else 'list'}", _REMEDY)
    return value


def _require_id(path: Path, value: Any, name: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int) or not str(value).strip():
        raise DataError(path, f"{name} is {str(value)[:60]!r}, no ID", _REMEDY)
    return str(value)


def _require_size(path: Path, value: Any, name: str) -> Size:
    fits = isinstance(value, list) and len(value) == 3
    if not fits or not all(isinstance(n, int | float) and not isinstance(n, bool) and 0 < n < 1e4 for n in value):
        raise DataError(path, f"{name} is {str(value)[:60]}, expected length, width and height in metres", _REMEDY)
    return float(value[0]), float(value[1]), float(value[2])
