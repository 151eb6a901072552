"""``instdrive tracks``: find what moves in a clip's LiDAR sweeps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import DataError

if TYPE_CHECKING:
    from instdrive_core.scene.track import Track


def tracks(
    clip: Positional[Path],
    out: Annotated[Path | None, arg(aliases=["-o"])] = None,
    held_out: bool = False,
    options: Annotated[ClipOptions, tyro.conf.OmitArgPrefixes] = ClipOptions(),  # noqa: B008 (frozen)
) -> None:
    """Find what moves in a clip's LiDAR sweeps, without cuboids or classes.

    Args:
        clip: Folder of the clip, in PandaSet's layout.
        out: File to write, .json; default: `tracks.json` in the clip's folder.
        held_out: Use the sweeps of held-out time steps, too; leave this off for what trains.
        options: Which part of the clip to use.
    """
    from rich.progress import Progress

    from instdrive_core.datasets.checks.drive import describe_faults
    from instdrive_core.datasets.registry import load_clip
    from instdrive_core.tracks.finder import find_tracks
    from instdrive_core.tracks.track_file import FILE, write_track_file

    loaded = load_clip(str(clip), options)
    if not loaded.sweeps:
        problem = "has no LiDAR sweeps (lidar/NN.pkl.gz) to find moving objects in"
        raise DataError(clip, problem, "Add sweeps, or choose frames that have some")
    with Progress(transient=True) as bar:
        task = bar.add_task("reading", total=None)
        found = find_tracks(loaded, held_out, lambda stage: bar.update(task, description=stage))
    for note in (*describe_faults(loaded), *found.notes):
        print(note)
    _print_table(found.tracks)
    file = out if out is not None else clip / FILE
    try:
        write_track_file(file, found, loaded)
    except OSError as error:
        raise DataError(file, f"cannot be written ({error})", "Choose another file with --out") from error
    print(f"{len(found.tracks)} moving objects: {file}")


def _print_table(found: tuple[Track, ...]) -> None:
    if not found:
        return
    print(f"{'track':<10} {'label':<19} {'from s':>7} {'to s':>7} {'way m':>7} {'size m (w × l × h)':>20}")
    for track in found:
        width, length, height = track.dimensions
        print(
            f"{track.id:<10} {track.label:<19} {track.times[0]:>7.2f} {track.times[-1]:>7.2f} "
            f"{track.compute_path_length():>7.1f} {f'{width:.1f} × {length:.1f} × {height:.1f}':>20}"
        )
