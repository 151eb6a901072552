"""``python -m benchmarks.layouts``: a drive written in every layout and read back. One JSON line.

Per layout: whether the photos' pixels are equal, the largest error of poses, points (metres) and boxes (metres), and
with ``--train`` the gap in PSNR between the ``demo`` preset trained from the original and from the layout.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import tyro

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.clip_comparison import compare_clips
from instdrive_core.datasets.clip_recordings import record_clip
from instdrive_core.datasets.registry import DATA_SETS, DataSet, load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street


@dataclass(frozen=True)
class Options:
    """What is written, and whether it is trained."""

    clip: Path | None = None
    """A clip's folder; default: a synthetic street is recorded."""
    steps: int = 4
    """Time steps of it."""
    width: int = 480
    """Width of the synthetic street's photos."""
    layouts: tuple[str, ...] = ()
    """Only these, by title; default: all that are written."""
    train: bool = False
    """Train the preset `demo` from the original and from each layout: half an hour or more on two cores."""


def measure_layouts(options: Options) -> dict[str, Any]:
    """Write, read back and compare; the figures by layout."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        source = options.clip
        if source is None:
            source = folder / "street"
            config = StreetConfig(steps=options.steps, width=options.width, height=options.width * 9 // 16)
            write_street(source, config)
        original = _load_part(source, options.steps)
        written = [data_set for data_set in DATA_SETS if data_set.write is not None]
        chosen = [data_set for data_set in written if data_set.title in options.layouts or not options.layouts]
        found = {one.title: _measure(original, one, folder / str(number)) for number, one in enumerate(chosen)}
        if options.train:
            _measure_gaps(original, found, folder)
        for entry in found.values():
            del entry["folder"]
        return {"clip": original.name, "steps": options.steps, "layouts": found}


def _load_part(source: Path, steps: int) -> Clip:
    """The first steps of a clip, at full size."""
    whole = load_clip(str(source), ClipOptions(scale=1.0))
    first = whole.frames[0].view.index
    return load_clip(str(source), ClipOptions(scale=1.0, first_frame=first, last_frame=first + steps - 1))


def _measure(original: Clip, layout: DataSet, folder: Path) -> dict[str, Any]:
    assert layout.write is not None
    start = time.perf_counter()
    opened = layout.write(record_clip(original), folder)
    middle = time.perf_counter()
    clip = layout.load(str(opened), ClipOptions(scale=1.0))
    pairs = tuple(zip(original.camera_names, clip.camera_names, strict=False))
    # A layout of one camera is compared with that camera; tracks keep the boxes of the steps there are.
    found = compare_clips(_trim_tracks(original), _trim_tracks(clip), pairs)
    return {
        "photos_equal": found.photos_equal,
        "pose_error": found.pose_error,
        "lens_error_px": found.lens_error,
        "point_error_m": found.point_error_m,
        "box_error_m": found.box_error_m,
        "psnr_gap": None,
        "photos": found.photos,
        "points": found.points,
        "boxes": found.boxes,
        "write_s": round(middle - start, 2),
        "read_s": round(time.perf_counter() - middle, 2),
        "folder": str(opened),
    }


def _trim_tracks(clip: Clip) -> Clip:
    """The clip with the boxes of its own steps only."""
    times = sorted({frame.view.time for frame in clip.frames})
    tracks = []
    for track in clip.tracks:
        kept = (track.times > times[0] - 0.02) & (track.times < times[-1] + 0.02)
        if kept.any():
            tracks.append(replace(track, times=track.times[kept], world_from_box=track.world_from_box[kept]))
    return replace(clip, tracks=tuple(tracks))


def _measure_gaps(original: Clip, found: dict[str, dict[str, Any]], work: Path) -> None:
    """Train from the original and from each layout; a layout of one camera is compared with that camera alone."""
    from benchmarks.train_layout import train_for_psnr  # loads torch, which nothing else here needs

    steps = [frame.view.index for frame in original.frames]
    first: dict[int, float] = {}
    for number, (title, entry) in enumerate(found.items()):
        cameras = len(load_clip(entry["folder"], ClipOptions()).camera_names)
        names = ",".join(original.camera_names[:cameras])
        if cameras not in first:
            options = ClipOptions(names, first_frame=steps[0], last_frame=steps[-1])
            first[cameras] = train_for_psnr(Path(original.path), options, work / f"original-{cameras}")
        trained = train_for_psnr(Path(entry["folder"]), ClipOptions(), work / f"layout-{number}")
        entry["psnr"], entry["psnr_gap"] = round(trained, 3), round(trained - first[cameras], 3)
        print(f"{title}: {trained:.3f} dB, gap {entry['psnr_gap']:+.3f} dB", file=sys.stderr)


if __name__ == "__main__":
    print(json.dumps(measure_layouts(tyro.cli(Options))))
