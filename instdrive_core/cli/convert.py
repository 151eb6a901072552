"""``instdrive convert``: from one scene format into another."""

from __future__ import annotations

from pathlib import Path

import tyro

from instdrive_core.cli.arguments import choose_time
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import find_format_to_write, open_scene, save_scene
from instdrive_core.project.open import open_edited_scene
from instdrive_core.project.save import is_project
from instdrive_core.scene.scene import Scene


def convert(
    scene: tyro.conf.Positional[Path],
    out: tyro.conf.Positional[Path],
    *,
    time: float | None = None,
    sibr: bool = False,
    keep_every: int = 1,
) -> None:
    """Convert a scene into the format that the new name ends in.

    Args:
        scene: Scene file, run folder, or project; of a project, what its edits made of the scene.
        out: File to write, e.g. street.compressed.ply, or a folder; docs/formats.md says what each format keeps.
        time: Seconds into the drive at which a file shows moving objects; default: the first photo's.
        sibr: Write the .ply for SIBR viewers: exact columns, SH degree 3, nothing else; so does the ending .sibr.ply.
        keep_every: 3 opens every 3rd splat only, each made larger: for scenes that do not fit into memory.
    """
    if is_project(out):
        remedy = f"`instdrive apply {scene} -o {out}` makes a project of a scene"
        raise DataError(out, "a project keeps edits and no splats, so nothing can be converted into one", remedy)
    opened = open_edited_scene(scene, keep_every, time)
    for sentence in opened.left_out:
        print(f"left out on opening: {sentence}")
    freezes = bool(opened.actors) and not find_format_to_write(out, sibr)[0].keeps_tracks
    if time is not None or freezes:
        time = choose_time(opened, time)
    if freezes:
        print(f"moving objects are placed where they are at {time:g} s (--time)")
    if time is not None:
        everything = len(opened)
        opened = freeze_at_time(opened, time)
        if len(opened) < everything:
            print(f"{everything - len(opened):,} splats of objects that are not there at that time are left out")
    before = _describe_contents(opened)
    save_scene(out, opened, sibr=sibr)
    # Two scenes at once would not fit where one just does.
    del opened
    after = _describe_contents(open_scene(out))
    if before["splats"] != after["splats"]:
        problem = f"{after['splats']} came back when the file was read again, not {before['splats']}"
        raise DataError(out, problem, "Look whether another program writes to the file, and try again")
    print(f"{out}: {after['splats']}")
    left_out = [text for label, text in before.items() if not _is_kept(label, text, after)]
    if left_out:
        print(f"left out or changed, as the format has no place for it: {', '.join(left_out)} (docs/formats.md)")


def _is_kept(label: str, text: str, after: dict[str, str]) -> bool:
    if label == "sh":
        # Zeros above the scene's own degree change nothing; degrees have one digit, so that texts compare as numbers.
        return after.get(label, "") >= text
    return after.get(label) == text


def _describe_contents(scene: Scene) -> dict[str, str]:
    """What the scene holds besides plain Gaussians, in words; what it does not hold is absent."""
    gaussians = scene.gaussians
    counts = {
        "splats": f"{len(scene):,} splats",
        "sh": f"SH degree {gaussians.sh_degree}" if gaussians.sh_degree else "",
        "instances": f"{len(scene.table)} instances" if len(scene.table) else "",
        "features": f"{gaussians.features.shape[1]} features per splat" if gaussians.features.shape[1] else "",
        "columns": f"the columns {', '.join(scene.extra)}" if scene.extra else "",
        "actors": f"{len(scene.actors)} tracks" if scene.actors else "",
        "views": f"{len(scene.views)} photo cameras" if scene.views else "",
        "exposures": "exposures" if scene.exposures is not None else "",
        "sky": "sky" if scene.sky is not None else "",
        "origin": "the origin" if scene.origin.any() else "",
        "antialiased": "that it is antialiased" if scene.antialiased else "",
    }
    return {label: text for label, text in counts.items() if text}
