"""``instdrive synth``: a synthetic driving clip."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from instdrive_core.datasets.synthetic.config import RecordingFlaws


def record_synthetic_drive(
    out: Annotated[Path, tyro.conf.Positional],
    seed: int = 0,
    steps: int = 20,
    width: int = 480,
    height: int = 270,
    traffic: Literal["flowing", "jam"] = "flowing",
    lidar: Literal["pandar64", "hdl64", "hdl32", "vlp16"] = "pandar64",
    rate: int = 10,
    flaws: Annotated[RecordingFlaws, tyro.conf.OmitArgPrefixes] = RecordingFlaws(),  # noqa: B008 (frozen)
) -> None:
    """Write a synthetic driving clip in PandaSet's layout, with exact instance labels.

    Args:
        out: New or empty folder for the clip.
        seed: Chooses the street, its traffic and the light; the same seed gives the same files.
        steps: Time steps, 1 to 400.
        width: Width of the photos in pixels; PandaSet's are 1920×1080.
        height: Height of the photos in pixels.
        traffic: 'jam' fills three lanes with vehicles that stop and go.
        lidar: Whose beams the LiDAR has: PandaSet's, KITTI's, nuScenes', or a small one of 16.
        rate: Time steps a second, 1 to 20.
        flaws: What real recordings have; the truth is kept in the clip's folder 'labels'.
    """
    from rich.progress import Progress

    from instdrive_core.datasets.synthetic.config import StreetConfig
    from instdrive_core.datasets.synthetic.write import write_street

    config = StreetConfig(
        seed=seed, steps=steps, width=width, height=height, traffic=traffic, flaws=flaws, lidar=lidar, rate=rate
    )
    with Progress(transient=True) as bar:
        task = bar.add_task(f"Recording {out}", total=steps)
        write_street(out, config, lambda done, _: bar.update(task, completed=done))
    print(f"{out}: {steps} time steps of 6 cameras at {width}×{height}, LiDAR, boxes and labels")
