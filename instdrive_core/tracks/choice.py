"""Which tracks a clip's moving objects are taken from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.tracks.finder import FoundTracks, find_tracks
from instdrive_core.tracks.track_file import FILE, read_track_file, write_track_file

TrackSource = Literal["none", "annotated", "found"]


def default_source(clip: Clip) -> TrackSource:
    """Annotated tracks where a clip has cuboids, else found ones where it has LiDAR, else none."""
    if clip.tracks:
        return "annotated"
    return "found" if clip.sweeps else "none"


def with_tracks(
    clip: Clip, source: TrackSource | None, kept_in: Path, on_note: Callable[[str], None] = lambda note: None
) -> Clip:
    """A clip with the tracks of one source.

    Args:
        clip: as its data set gives it.
        source: None = `default_source`.
        kept_in: folder in which found tracks are kept, and looked for first: that of the run.
        on_note: is told what the user should know.

    Raises DataError where tracks cannot be taken from there.
    """
    chosen = default_source(clip) if source is None else source
    if chosen == "none":
        return replace(clip, tracks=())
    if chosen == "annotated":
        if not clip.tracks:
            raise DataError(clip.path, "has no cuboids", "Use --tracks found where there is LiDAR, or --tracks none")
        return clip
    if not clip.sweeps:
        raise DataError(clip.path, "has no LiDAR sweeps to find moving objects in", "Use --tracks none")
    found = choose_kept_tracks(clip, kept_in, on_note)
    for note in found.notes:
        on_note(note)
    on_note(f"{len(found.tracks)} moving objects found in the LiDAR sweeps")
    return replace(clip, tracks=found.tracks)


def choose_kept_tracks(clip: Clip, folder: Path, on_stage: Callable[[str], None] = lambda stage: None) -> FoundTracks:
    """The tracks kept in a folder; found and kept there where there are none yet."""
    file = folder / FILE
    if file.is_file():
        return read_track_file(file, clip)
    found = find_tracks(clip, on_stage=lambda stage: on_stage(f"moving objects: {stage}"))
    write_track_file(file, found, clip)
    return found
