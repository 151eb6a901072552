"""``actor_assets.json`` of a bundle: the body of each moving thing, in its own axes, and which track it stands on."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.splatsim.fields import require_equal, take, take_vector
from instdrive_core.formats.splatsim.layout import ASSETS, ASSETS_SCHEMA, OBJECT_FRAME, OWN_DATA, REMEDY

RIGID, UNIFORM, STRETCH = "rigid", "uniform", "stretch"
"""How a body fits its track's box: as it is, scaled as a whole, or scaled by axis."""
_ALLOWED = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")


@dataclass(frozen=True)
class Body:
    """The splats of a thing."""

    id: str
    uri: str
    label: str
    size: Float64[ndarray, "3"]
    """Length, width, height of the box that it was made for, metres."""
    count: int
    degree: int
    own: Mapping[str, Any]
    """What this program wrote of the instance."""


@dataclass(frozen=True)
class Standing:
    """A body on a track."""

    track: str
    body: Body
    fit: str = RIGID


def parse_assets(path: Path, document: Any) -> tuple[tuple[Body, ...], tuple[Standing, ...]]:
    """Parse bodies and what stands where. Raises DataError naming what is wrong."""
    require_equal(path, document.get("schema"), ASSETS_SCHEMA, f"the schema of {ASSETS}")
    require_equal(path, document.get("frame"), "object", f"the frame of {ASSETS}")
    require_equal(path, document.get("object_frame"), OBJECT_FRAME, f"the object frame of {ASSETS}")
    bodies = {
        body.id: body for body in (_parse_body(path, entry) for entry in take(path, document, "assets", list, ASSETS))
    }
    standing: dict[str, Standing] = {}
    for entry in document.get("instances") or []:
        track, asset = (take(path, entry, key, str, f"an instance of {ASSETS}") for key in ("track_id", "asset_id"))
        fit = entry.get("fit_mode", RIGID)
        if asset not in bodies or track in standing or fit not in (RIGID, UNIFORM, STRETCH):
            problem = f"an instance of {ASSETS} binds track {track[:60]!r} twice, to no asset, or in no known way"
            raise DataError(path, problem, REMEDY)
        standing[track] = Standing(track, bodies[asset], fit)
    return tuple(bodies.values()), tuple(standing.values())


def describe_assets(standing: Sequence[Standing], bounds: Mapping[str, Float64[ndarray, "2 3"]]) -> dict[str, Any]:
    """Describe bodies and tracks as a document; `bounds` are the means of each body's splats, by its ID.

    The bounds are widened to hold the origin, as readers take a body without it for one in the world's axes.
    """
    return {
        "schema": ASSETS_SCHEMA,
        "frame": "object",
        "object_frame": OBJECT_FRAME,
        "assets": [_describe_body(each.body, bounds[each.body.id]) for each in standing],
        "instances": [
            {"track_id": each.track, "asset_id": each.body.id, "fit_mode": each.fit, "metadata": {}}
            for each in standing
        ],
    }


def name_body(wanted: str, taken: set[str]) -> str:
    """Name a body so that its name is a folder's and no other's, and remember it."""
    base = re.sub(r"[^A-Za-z0-9._-]", "_", wanted)[:100].lstrip("._-") or "object"
    name, number = base, 2
    while name in taken:
        name, number = f"{base}_{number}", number + 1
    taken.add(name)
    return name


def get_asset_member(name: str) -> str:
    """The member of the bundle that holds a body."""
    return f"actor_assets/{name}/asset.spz"


def _parse_body(path: Path, entry: Any) -> Body:
    name = take(path, entry, "asset_id", str, f"an asset of {ASSETS}")
    where = f"asset {name[:60]!r}"
    if not _ALLOWED.fullmatch(name):
        raise DataError(path, f"'asset_id' is {name[:60]!r}, no name of a folder", REMEDY)
    require_equal(path, entry.get("motion", RIGID), RIGID, f"the motion of {where}")
    size = take_vector(path, entry, "size", 3, where)
    count = take(path, entry, "n_points", int, where)
    if not (size > 0).all() or count <= 0:
        raise DataError(path, f"{where} has no size or no splats", REMEDY)
    uri = entry.get("uri") or get_asset_member(name)
    metadata = entry.get("metadata")
    own = metadata.get(OWN_DATA) if isinstance(metadata, dict) else None
    label = take(path, entry, "class_name", str, where)
    degree = entry.get("sh_degree", 0)
    degree = degree if isinstance(degree, int) and 0 <= degree <= 3 else 3
    return Body(name, uri, label, size, count, degree, own if isinstance(own, dict) else {})


def _describe_body(body: Body, bounds: Float64[ndarray, "2 3"]) -> dict[str, Any]:
    return {
        "asset_id": body.id,
        "uri": body.uri,
        "class_name": body.label,
        "motion": RIGID,
        "size": body.size.tolist(),
        "bbox_min": np.minimum(bounds[0], 0.0).tolist(),
        "bbox_max": np.maximum(bounds[1], 0.0).tolist(),
        "n_points": body.count,
        "sh_degree": body.degree,
        "provenance": {},
        "metadata": {OWN_DATA: dict(body.own)},
    }
