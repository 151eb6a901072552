"""Objects of a hand-over to NuRec, or of its asset harvester, as scenes of one actor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X
from instdrive_core.formats.nurec.writing import ASSETS
from instdrive_core.formats.ply.inria import read_ply
from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import transform_gaussians

_BOX_FROM_OBJECT = np.c_[BOX_FROM_FORWARD_X, np.zeros(3)]


def find_asset(folder: Path, name: str) -> Path:
    """Find the .ply of an asset: ``ID/ID.ply`` or ``ID/gs.ply`` in ``external_assets`` or in the folder itself.

    Raises DataError where there is none, UntrustedDataError for a name that leads out of the folder.
    """
    if not name or Path(name).name != name or name in (".", ".."):
        problem = f"the asset {name[:80]!r} is a path; only objects inside the folder are read"
        raise UntrustedDataError(folder, problem, f"Copy it to {ASSETS}/ID/ID.ply and name it ID")
    name = name.partition("@")[0] or name
    for root in (folder / ASSETS, folder):
        for file in (root / name / f"{name}.ply", root / name / "gs.ply"):
            if file.is_file():
                return file
    raise DataError(folder, f"it holds no {ASSETS}/{name}/{name}.ply", "Copy the folder whole")


def read_object(file: Path, track: Track) -> Scene:
    """Read an object and let it be the actor of a track. Raises DataError where it is damaged or empty."""
    found = read_ply(file)
    if not len(found):
        raise DataError(file, "it holds no splats", "Export the object again")
    gaussians = found.gaussians
    transform_gaussians(gaussians, _BOX_FROM_OBJECT)
    nodes, ids = np.ones(len(gaussians), np.uint16), np.ones(len(gaussians), np.uint32)
    table = build_instance_table(ids, gaussians.means, None, nodes, {1: track.id}, {1: track.label})
    zeros = np.zeros(len(gaussians), np.uint32)
    return replace(found, instance_ids=ids, codewords=zeros, nodes=nodes, table=table, actors=(track,), extra={})
