"""`instdrive train`: a clip becomes a scene with instances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, arg

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import (
    Device,
    Method,
    PieceChoice,
    Preset,
    build_train_config,
    keep_geometry,
)


def train(
    clip: Positional[Path],
    out: Annotated[Path, arg(aliases=["-o"])],
    method: Method = "instdrive",
    preset: Preset = "quick",
    seed: int = 0,
    masks: Path | None = None,
    resume: bool = False,
    init: Path | None = None,
    freeze_geometry: bool = False,
    static: bool = False,
    tracks: Literal["none", "annotated", "found"] | None = None,
    device: Device = "auto",
    iterations: int | None = None,
    max_gaussians: int | None = None,
    pieces: PieceChoice = "auto",
    options: Annotated[ClipOptions, tyro.conf.OmitArgPrefixes] = ClipOptions(),  # noqa: B008 (frozen)
) -> None:
    """Train a driving clip into Gaussians with instance IDs.

    Args:
        clip: Folder of the clip: in PandaSet's layout, of a COLMAP model, or with nerfstudio's transforms.json.
        out: Folder of the run; `instdrive edit` opens it.
        method: Where instances come from: `instdrive` (ours: photos' masks vote), `paper` (the printed losses), or a
            baseline: `mask-graph`, `gaussian-grouping`, `opengaussian`.
        preset: Length: `demo` (≤ 5 minutes on 2 cores), `quick` (≤ 20 minutes) or `paper` (30,000 iterations).
        seed: Of everything random.
        masks: Folder of masks; default: the clip's own `masks/`, else masks made from its annotations.
        resume: Go on from the folder's checkpoint.
        init: Start from this scene file or run instead of LiDAR points.
        freeze_geometry: Keep the Gaussians of --init as they are and learn instances only.
        static: Treat everything as background, also what moves.
        tracks: Where moving objects are taken from: `annotated` (cuboids), `found` (in the LiDAR sweeps, no labels)
            or `none`; default: annotated where the clip has cuboids, else found where it has LiDAR.
        device: `cuda` trains on an NVIDIA GPU with gsplat; `auto` does where both are there.
        iterations: Steps that train colour and shape; default: the preset's, `quick` as many more as a clip has more
            photos than 162.
        max_gaussians: Gaussians that may grow; default: the preset's, `quick` more for a longer way and larger photos.
        pieces: Pieces that a drive is cut into along the road, trained in turn and joined; `auto`: one, but several for
            drives of more than 150 m or 648 training photos. Other settings are those of each piece.
        options: Which part of the clip to use.
    """
    from instdrive_core.baselines.registry import find_learner
    from instdrive_core.cli.train_progress import train_with_progress
    from instdrive_core.training.run import RunRequest

    config = build_train_config(method, preset, seed)
    if static:
        config = replace(config, init=replace(config.init, moving_actors=False))
    if freeze_geometry:
        config = keep_geometry(config)
    train_with_progress(
        RunRequest(
            clip,
            out,
            options,
            config,
            masks,
            resume,
            init,
            device,
            find_learner(method, preset),
            AskedSizes(iterations, max_gaussians),
            tracks,
            pieces,
        )
    )
    print(f"trained scene: {out} (open it with: instdrive edit {out})")
