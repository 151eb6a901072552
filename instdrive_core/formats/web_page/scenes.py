"""Pages as a scene format: what this program has written opens again, with its instances."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.formats.sog.meta import parse_sog_meta
from instdrive_core.formats.sog.scenes import META, read_sog_gaussians
from instdrive_core.formats.sog.store import BAD_MEMBER, ZipStore
from instdrive_core.formats.web_page.axes import SCENE_FROM_FILE, bound_page_error, order_for_page
from instdrive_core.formats.web_page.content import (
    ABOUT,
    IDS,
    REMEDY,
    SPLATS,
    decode_about,
    decode_ids,
    decode_splats,
    read_elements,
)
from instdrive_core.formats.web_page.writing import write_web_page
from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.scene import Scene, scene_from_gaussians
from instdrive_core.scene.transforms import transform_gaussians

_MOST_IDS = 1 << 24
_FARTHEST = 1e9


def read_web_page(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a page that this program has written. Raises DataError where it is another page, or damaged."""
    path = Path(path)
    elements = read_elements(path)
    about = decode_about(elements[ABOUT], path)
    try:
        archive = zipfile.ZipFile(io.BytesIO(decode_splats(elements.pop(SPLATS), path)))
    except BAD_MEMBER as error:
        raise DataError(path, f"its splats are no whole .sog ({error})", REMEDY) from error
    with archive:
        store = ZipStore(path, archive)
        meta = parse_sog_meta(store.read_json(META), path)
        gaussians = read_sog_gaussians(store, meta, options)
    transform_gaussians(gaussians, SCENE_FROM_FILE)
    ids = decode_ids(elements[IDS], meta.count, path)[:: options.keep_every].copy()
    if int(ids.max(initial=0)) >= _MOST_IDS:
        raise DataError(path, f"a splat has instance {int(ids.max())}, above the limit of {_MOST_IDS - 1}", REMEDY)
    names, classes = _parse_instances(about.get("instances"))
    return replace(
        scene_from_gaussians(gaussians),
        instance_ids=ids,
        table=build_instance_table(ids, gaussians.means, None, None, names, classes),
        origin=_parse_origin(about.get("origin"), path),
        antialiased=meta.antialiased,
    )


def _parse_instances(entries: Any) -> tuple[dict[int, str], dict[int, str]]:
    """Names and classes by ID; what is not as it should be is passed over."""
    names, classes = {}, {}
    for key, entry in entries.items() if isinstance(entries, dict) else ():
        if not (key.isascii() and key.isdecimal() and len(key) < 9 and isinstance(entry, dict)):
            continue
        for found, value in ((names, entry.get("name")), (classes, entry.get("class"))):
            if isinstance(value, str) and value:
                found[int(key)] = value
    return names, classes


def _parse_origin(value: Any, path: Path) -> Float64[ndarray, "3"]:
    good = isinstance(value, list) and len(value) == 3
    if not good or not all(isinstance(entry, int | float) and abs(entry) < _FARTHEST for entry in value):
        raise DataError(path, "'origin' of the page is not three numbers", REMEDY)
    return np.array(value, np.float64)


WEB_PAGE = Format(
    "Web page with a viewer",
    ".html",
    read_web_page,
    write_web_page,
    Fidelity(bound_page_error, order_for_page),
    up="+z",
)
