"""``instdrive apply``: edits from the command line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from instdrive_core.cli.arguments import (
    check_known_ids,
    choose_time,
    find_default_time,
    find_first_camera,
    parse_assignment,
    parse_color,
)
from instdrive_core.cli.deletion_options import DeletionOptions, find_gone
from instdrive_core.cli.driving.path_options import PathOptions
from instdrive_core.cli.edit_options import EditOptions
from instdrive_core.cli.light.shadow_options import ShadowOptions
from instdrive_core.cli.nurec_options import NurecOptions
from instdrive_core.cli.part_options import PartOptions
from instdrive_core.cli.turn_options import TurnOptions
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.color import RecolorInstances, RecolorMode
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.edits.kinds.light.cast_shadows import list_put
from instdrive_core.edits.kinds.paint import PaintInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.overlaps import describe_overlap, find_overlaps, list_drive_times
from instdrive_core.edits.queries.scene_parts import bake_part
from instdrive_core.edits.serialize import edits_from_lines
from instdrive_core.errors import DataError, EditError, OptionError
from instdrive_core.formats.registry import find_format_to_write, save_scene
from instdrive_core.project.open import open_document
from instdrive_core.project.save import is_project, save_project
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import format_count


def apply(
    scene: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])],
    delete: tuple[int, ...] = (),
    recolor: tuple[str, ...] = (),
    recolor_mode: RecolorMode | Literal["paint"] = "tint",
    rename: tuple[str, ...] = (),
    turn: Annotated[TurnOptions, tyro.conf.OmitArgPrefixes] = TurnOptions(),  # noqa: B008 (frozen)
    more: Annotated[EditOptions, tyro.conf.OmitArgPrefixes] = EditOptions(),  # noqa: B008 (frozen)
    find_objects: bool = False,
    after_deletion: Annotated[DeletionOptions, tyro.conf.OmitArgPrefixes] = DeletionOptions(),  # noqa: B008 (frozen)
    parts: Annotated[PartOptions, tyro.conf.OmitArgPrefixes] = PartOptions(),  # noqa: B008 (frozen)
    paths: Annotated[PathOptions, tyro.conf.OmitArgPrefixes] = PathOptions(),  # noqa: B008 (frozen)
    light: Annotated[ShadowOptions, tyro.conf.OmitArgPrefixes] = ShadowOptions(),  # noqa: B008 (frozen)
    exchange: Annotated[NurecOptions, tyro.conf.OmitArgPrefixes] = NurecOptions(),  # noqa: B008 (frozen)
    edits: Path | None = None,
    time: float | None = None,
    sibr: bool = False,
    keep_every: int = 1,
) -> None:
    """Edit a scene without a window and export it.

    Args:
        scene: Scene file, run folder, or project, whose edits are done first.
        out: File to write (.ply or another format), a folder, which keeps tracks, cameras and sky, or a project
            (.instdrive), which keeps the edits beside the scene.
        delete: IDs of instances to delete.
        recolor: Recolours as ID=#rrggbb.
        recolor_mode: `tint` keeps light and shade, `hue` turns hues and keeps greys, `solid` is the plain colour,
            `paint` changes only what is near the colour of an object's body.
        rename: New names as ID=NAME.
        turn: How the scene is stood upright, after the edits of the file.
        more: Other edits, done after those of the file and before renaming, recolouring and deleting.
        find_objects: Make instances of what stands on the ground and hangs together, in a scene that has none and is
            upright by then. Done after the edits of the file and --up; the options below can name the new IDs.
        after_deletion: What is told of deletions, and done about what they leave.
        parts: What is written besides the whole scene, or instead of it.
        paths: Other ways for vehicles, after those other edits.
        light: Shadows below what is put somewhere; edits of a file (--edits) lay only those they name.
        exchange: What is taken from NVIDIA NuRec and handed over to it.
        edits: File with one edit as JSON per line, done before the others.
        time: Seconds into the drive at which a .ply shows moving objects; default: the first photo's.
        sibr: Write the .ply for SIBR viewers: exact columns, SH degree 3, nothing else; so does the ending .sibr.ply.
        keep_every: 3 opens every 3rd splat only, each made larger: for scenes that do not fit into memory.
    """
    document, view = open_document(scene, keep_every=keep_every)
    shown = choose_time(document.scene, time)
    first = [*(_read_edit_log(edits) if edits else []), *turn.edits(document, scene)]
    is_turned = any(isinstance(step, TurnScene) for step in first)
    done = _find_upright_objects(document, first) if find_objects else []
    steps = [*first[len(done) :]]
    placed = [*more.edits(document, shown, is_turned), *paths.edits(document)]
    steps += placed
    steps += _collect_edits(document.scene, delete, recolor, recolor_mode, rename)
    gone_before = find_gone(document)
    for edit in (*exchange.read_edits(document), *steps):
        document.apply(edit)
    light.follow(document, placed, shown)
    put = list_put(steps)
    for overlap in find_overlaps(document, put.ids, list_drive_times(document), put.added):
        print(f"overlap: {describe_overlap(document, overlap)}")
    after_deletion.follow(document, [*done, *steps], gone_before, shown)
    rows = parts.rows(document)
    if is_project(out):
        if rows is not None:
            raise OptionError("a project keeps the edits of a whole scene; give --only another --out, e.g. part.ply")
        parts.write(document, shown, "", sibr)
        exchange.write(document)
        save_project(out, document, view)
        print(f"{out}: {format_count(len(document.history.done), 'edit')} of {scene}")
        return
    fmt, _ = find_format_to_write(out, sibr)
    if time is None and document.scene.actors and not fmt.keeps_tracks:
        time = find_default_time(document.scene)
        print(f"moving objects are placed where they are at {time:g} s (--time)")
    if rows is None:
        start = None if sibr else find_first_camera(document.scene, time)
        result = replace(bake_document(document, time), start=start)
    else:
        result = bake_part(document, rows, time)
    save_scene(out, result, sibr=sibr)
    parts.write(document, shown, fmt.suffix, sibr)
    exchange.write(document)
    held = f"{format_count(len(result), 'splat')}, {format_count(len(result.table), 'instance')}"
    print(f"{out}: {held} ({format_count(len(document.history.done), 'edit')} applied)")


def _find_upright_objects(document: Document, first: list[Edit]) -> list[Edit]:
    """Do the edits that come first, then make instances of what stands on the ground; returns what was done."""
    for edit in first:
        document.apply(edit)
    known = len(document.scene.table)
    document.apply(FindObjects())
    print(f"found: {format_count(len(document.scene.table) - known, 'object')}")
    return first


def _collect_edits(
    scene: Scene,
    delete: tuple[int, ...],
    recolor: tuple[str, ...],
    mode: RecolorMode | Literal["paint"],
    rename: tuple[str, ...],
) -> list[Edit]:
    steps: list[Edit] = []
    for text in rename:
        instance_id, name = parse_assignment(text, "--rename 4=taxi")
        check_known_ids([instance_id], scene.table)
        steps.append(RenameInstance(instance_id, name))
    for text in recolor:
        instance_id, color = parse_assignment(text, "--recolor 4=#d02020")
        ids = check_known_ids([instance_id], scene.table)
        rgb = parse_color(color)
        steps.append(PaintInstances(ids, rgb) if mode == "paint" else RecolorInstances(ids, mode, rgb))
    if delete:
        steps.append(DeleteInstances(check_known_ids(delete, scene.table)))
    return steps


def _read_edit_log(path: Path) -> list[Edit]:
    try:
        return edits_from_lines(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, EditError) as error:
        raise DataError(path, f"the edits cannot be read ({error})", "Each line must be one edit as JSON") from error
