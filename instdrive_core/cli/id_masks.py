"""``instdrive id-masks``: instance masks of a scene, as its photos' cameras see them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from instdrive_core.errors import OptionError
from instdrive_core.masks.export.coco_panoptic import write_coco_panoptic
from instdrive_core.masks.export.id_maps import choose_views, render_id_maps
from instdrive_core.masks.export.id_pictures import write_id_pictures
from instdrive_core.project.open import open_edited_scene

WRITERS = {"png": write_id_pictures, "coco": write_coco_panoptic}


def export_id_masks(
    scene: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])],
    format: Literal["png", "coco"] = "png",
    camera: str | None = None,
    every: int = 1,
    scale: float = 1.0,
) -> None:
    """Write instance masks as the cameras of a scene's photos see them.

    Args:
        scene: Run or scene folder, or a project on one; other files keep no cameras.
        out: Folder to write into.
        format: `png`: colours of the bijective ID map and plain labels; `coco`: COCO's panoptic format.
        camera: Only this camera, e.g. front_camera.
        every: Only every so many time steps.
        scale: Size of the masks relative to the photos that were trained with; larger ones are drawn, not stretched.
    """
    from rich.progress import MofNCompleteColumn, Progress

    if out.exists() and not out.is_dir():
        raise OptionError(f"{out} is a file; name a folder")
    opened = open_edited_scene(scene)
    views = choose_views(opened, camera, every)
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), transient=True) as progress:
        task = progress.add_task("masks", total=len(views))
        count = WRITERS[format](
            out, opened, render_id_maps(opened, views, scale), lambda done: progress.update(task, completed=done)
        )
    if not opened.instance_ids.any():
        print("the scene has no instances: all masks are empty")
    print(f"{out}: masks of {count} photo{'s' * (count != 1)}, {len(opened.table)} instances ({format})")
