"""``python -m benchmarks.layouts``: a drive written in every layout and read back. One JSON line.

Per layout: whether the photos' pixels are equal, the largest error of poses, points (metres) and boxes (metres), and
with ``--train`` the gap in PSNR between the ``demo`` preset trained from the original and from the layout. Both make
their own masks, are seeded alike and are measured on the same pixels; `psnr_noise` is what seeds change: one held-out
photo is a matter of luck.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory
from typing import Any

import tyro
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.datasets.clip import HOLD_OUT_PERIOD, Clip, ClipOptions, is_held_out
from instdrive_core.datasets.clip_comparison import compare_clips
from instdrive_core.datasets.clip_recordings import record_clip
from instdrive_core.datasets.registry import DATA_SETS, DataSet, load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import OptionError


@dataclass(frozen=True)
class Options:
    """What is written, and whether it is trained."""

    clip: Path | None = None
    """A clip's folder; default: a synthetic street is recorded."""
    steps: int = 6
    """Time steps of it. Training holds out the fifth of ten, and needs as many."""
    width: int = 480
    """Width of the synthetic street's photos."""
    layouts: tuple[str, ...] = ()
    """Only these, by title; default: all that are written."""
    train: bool = False
    """Train the preset `demo` from the original and from each layout: an hour or more on two cores."""
    iterations: int | None = None
    """Steps of each training; default: the preset's 2,200."""
    seeds: int = 3
    """Trainings of each, of which the means are compared."""


def measure_layouts(options: Options) -> dict[str, Any]:
    """Write, read back and compare; the figures by layout."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        source = options.clip
        if source is None:
            source = folder / "street"
            config = StreetConfig(steps=options.steps, width=options.width, height=options.width * 9 // 16)
            write_street(source, config)
        original = _load_part(source, options.steps, options.train)
        written = [data_set for data_set in DATA_SETS if data_set.write is not None]
        chosen = [data_set for data_set in written if data_set.title in options.layouts or not options.layouts]
        found = {one.title: _measure(original, one, folder / str(number)) for number, one in enumerate(chosen)}
        if options.train:
            _measure_gaps(original, found, folder, options)
        for entry in found.values():
            del entry["folder"]
        training = {"iterations": options.iterations, "seeds": options.seeds} if options.train else {}
        size = {"width": max(frame.view.camera.width for frame in original.frames)}
        return {"clip": original.name, "steps": options.steps, **size, **training, "layouts": found}


def _load_part(source: Path, steps: int, train: bool) -> Clip:
    """The first steps of a clip, at full size.

    To train, they begin at a multiple of ten: layouts count steps from 0, and the same photos are to be held out.
    """
    listed = {frame.view.index for frame in load_clip(str(source), ClipOptions(scale=1.0)).frames}
    first = min(listed)
    if train:
        first += -first % HOLD_OUT_PERIOD
    last = first + steps - 1
    if train and not any(is_held_out(step) for step in listed if first <= step <= last):
        raise OptionError(f"{source}: no time step from {first} to {last} is held out; choose more --steps")
    return load_clip(str(source), ClipOptions(scale=1.0, first_frame=first, last_frame=last))


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


def _measure_gaps(original: Clip, found: dict[str, dict[str, Any]], work: Path, options: Options) -> None:
    """Train from the original and from each layout; a layout of one camera is compared with that camera alone."""
    from benchmarks.train_layout import PartOfDrive, train_for_psnr  # loads torch, which nothing else here needs

    steps = [frame.view.index for frame in original.frames]
    known: dict[int, _Reference] = {}
    for number, (title, entry) in enumerate(found.items()):
        part = PartOfDrive(Path(entry["folder"]), ClipOptions(), options.iterations)
        cameras = len(part.load().camera_names)
        if cameras not in known:
            names = ",".join(original.camera_names[:cameras])
            asked = ClipOptions(names, first_frame=steps[0], last_frame=steps[-1])
            whole = PartOfDrive(Path(original.path), asked, options.iterations)
            shown = tuple(frame.valid for frame in whole.load().held_out_frames)
            found_psnr = train_for_psnr(whole, work / f"original-{cameras}", shown, options.seeds)
            known[cameras] = _Reference(found_psnr, shown)
            print(f"original, cameras {names}: {_list_decibels(found_psnr)}", file=sys.stderr)
        reference = known[cameras]
        trained = train_for_psnr(part, work / f"layout-{number}", reference.shown, options.seeds)
        entry["psnr"] = round(fmean(trained), 3)
        entry["psnr_gap"] = round(fmean(trained) - fmean(reference.psnr), 3)
        entry["psnr_noise"] = round(max(reference.psnr) - min(reference.psnr), 3)
        print(f"{title}: {_list_decibels(trained)}, gap {entry['psnr_gap']:+.3f} dB", file=sys.stderr)


def _list_decibels(psnr: list[float]) -> str:
    return ", ".join(f"{one:.3f}" for one in psnr) + " dB"


@dataclass(frozen=True)
class _Reference:
    """What training from the original gives."""

    psnr: list[float]
    """A figure for each seed, in dB."""
    shown: tuple[Bool[ndarray, "h w"] | None, ...]
    """Pixels of each held-out photo that are compared."""


if __name__ == "__main__":
    print(json.dumps(measure_layouts(tyro.cli(Options))))
