"""The folder that is handed to NuRec: ``edit-assets.json`` and ``external_assets`` as its harvester does."""

from __future__ import annotations

import json
from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.nurec.edit_assets import NAME, write_asset_edits
from instdrive_core.formats.nurec.hand_over import HandOver
from instdrive_core.formats.ply.inria import write_ply
from instdrive_core.scene.scene import scene_from_gaussians

ASSETS, METADATA = "external_assets", "metadata.yaml"


def write_hand_over(folder: Path, plan: HandOver) -> tuple[Path, ...]:
    """Write the folder; ``edit-assets.json`` comes last, so that a folder without it is unfinished.

    Returns the files. Raises DataError where the folder holds a hand-over already, or cannot be written.
    """
    folder = Path(folder)
    if (folder / NAME).exists() or (folder.exists() and not folder.is_dir()):
        raise DataError(folder, f"it holds {NAME} already, or is a file", "Name a new folder")
    files = []
    described = {}
    for facts in plan.edits.assets:
        file = folder / ASSETS / facts.id / f"{facts.id}.ply"
        file.parent.mkdir(parents=True, exist_ok=True)
        write_ply(file, scene_from_gaussians(plan.objects[facts.id]))
        files.append(file)
        described[facts.id] = {
            "ply_file": f"{facts.id}/{facts.id}.ply",
            "label_class": facts.label,
            "cuboids_dims": list(facts.size),
        }
    (folder / ASSETS).mkdir(parents=True, exist_ok=True)
    with open_atomically(folder / ASSETS / METADATA) as out:  # JSON is YAML, too
        out.write(json.dumps({"assets": described}, indent=1).encode())
    write_asset_edits(folder / NAME, plan.edits)
    return (*files, folder / ASSETS / METADATA, folder / NAME)
