"""`instdrive masks`: write instance masks for a clip's training photos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, arg

from instdrive_core.datasets.clip import ClipOptions


def masks(
    clip: Positional[Path],
    source: Literal["exact", "annotations"] = "exact",
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    seed: int = 0,
    options: Annotated[ClipOptions, tyro.conf.OmitArgPrefixes] = ClipOptions(),  # noqa: B008 (frozen)
    faults: Literal["sam-v1"] | None = None,
) -> None:
    """Write instance masks for the training photos of a clip.

    Args:
        clip: Folder of the clip, in PandaSet's layout.
        source: `exact`: a synthetic clip's labels; `annotations`: made from cuboids, semantic classes and LiDAR.
        out: Folder of the masks; default: the clip's own `masks/`, where training looks for them.
        seed: Of the labels' order in each photo, and of the faults.
        options: Which part of the clip to use, and the masks' size.
        faults: Get masks wrong on purpose, as a segmenter would: `sam-v1` splits 25 % of the objects, merges 10 % of
            touching pairs, misses 10 % of the objects and makes borders ragged by up to 2 px.
    """
    from rich.progress import Progress

    from instdrive_core.datasets.clip import load_clip
    from instdrive_core.masks.sources import make_masks

    loaded = load_clip(str(clip), options)
    folder = out if out is not None else clip / "masks"
    with Progress(transient=True) as progress:
        task = progress.add_task(f"masks ({source})", total=len(loaded.training_frames()))
        written = make_masks(loaded, source, folder, seed, lambda done: progress.update(task, completed=done), faults)
    count = sum(written.counts.values())
    with_faults = f" with the faults {faults}" if faults else ""
    print(f"{count} masks in {len(written.counts)} photos, from {source}{with_faults}: {folder}")
