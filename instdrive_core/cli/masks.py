"""`instdrive masks`: write instance masks for a clip's training photos."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg
from tyro.extras import literal_type_from_choices

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import OptionError
from instdrive_core.masks.faults.registry import FaultModel
from instdrive_core.masks.sam.options import SamOptions
from instdrive_core.masks.sources import MASK_SOURCES, SourceOptions, describe_mask_sources

if TYPE_CHECKING:
    from instdrive_core.masks.label_map_folder import MaskFolder

    SourceName = str
else:
    SourceName = literal_type_from_choices([known.name for known in MASK_SOURCES])


def create_masks(
    clip: Positional[Path],
    source: Annotated[SourceName, arg(help=describe_mask_sources())] = "exact",
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    seed: int = 0,
    options: Annotated[ClipOptions, tyro.conf.OmitArgPrefixes] = ClipOptions(),  # noqa: B008 (frozen)
    faults: FaultModel | None = None,
    imported: Annotated[Path | None, arg(name="from")] = None,
    sheet: Path | None = None,
    sam: SamOptions = SamOptions(),  # noqa: B008 (frozen)
) -> None:
    """Write instance masks for the training photos of a clip.

    What was interrupted goes on where it stopped when the same command is given again.

    Args:
        clip: Folder of the clip.
        source: One of `MASK_SOURCES`.
        out: Folder of the masks; default: the clip's own `masks/`, where training looks for them.
        seed: Seed of the labels' order in each photo and of the faults.
        options: Which part of the clip to use, and the masks' size.
        faults: Get masks wrong on purpose, as a segmenter would: `sam-v1` in each photo by itself; `sam-v2` (also
            `-mild`, `-strong`) with faults that repeat over photos, in two overlapping layers, on synthetic clips.
        imported: Folder to import, a file per photo: CAMERA/NN as .png (label map), .npz (boolean masks) or .json (COCO
            run lengths).
        sheet: Picture to write for each camera: masks over some of its photos. A .jpg or .png file, or a folder.
        sam: How Segment Anything makes masks.
    """
    from instdrive_core.datasets.registry import load_clip
    from instdrive_core.masks.contact_sheet import check_sheet_path, write_contact_sheets
    from instdrive_core.masks.making import make_masks

    if sheet is not None:
        check_sheet_path(sheet)
    if imported is not None and source != "import":
        raise OptionError(f"--from {imported} is read by --source import only; the source is {source!r}")
    loaded = load_clip(str(clip), options)
    folder = out if out is not None else clip / "masks"
    total = len(loaded.training_frames)

    def make(on_frame: Callable[[int], None]) -> MaskFolder:
        return make_masks(loaded, source, folder, seed, on_frame, faults, SourceOptions(imported, sam))

    written = _show_progress(make, f"masks ({source})", total)
    count = sum(written.counts.values())
    with_faults = f" with the faults {faults}" if faults else ""
    print(f"{count} masks in {len(written.counts)} photos, from {source}{with_faults}: {folder}")
    if sheet is not None:
        print("Contact sheets:", *map(str, write_contact_sheets(loaded, written, sheet)))


def _show_progress(make: Callable[[Callable[[int], None]], MaskFolder], title: str, total: int) -> MaskFolder:
    """Run what makes masks under a bar; say so where it goes on with what was done before."""
    from rich.progress import MofNCompleteColumn, Progress

    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), transient=True) as progress:
        task = progress.add_task(title, total=total)
        told = False

        def show(done: int) -> None:
            nonlocal told
            if done and not told:
                progress.console.print(f"Going on where it stopped: {done} of {total} photos are done")
            told = True
            progress.update(task, completed=done)

        return make(show)
