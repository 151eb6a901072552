"""A drive's time steps, and the part of a clip that a piece is trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.scene.track import Track
from instdrive_core.training.pieces.plan import DriveStep, Piece


def list_steps(clip: Clip) -> list[DriveStep]:
    """List the time steps that have photos, in order."""
    places: dict[int, list[np.ndarray]] = {}
    photos: dict[int, int] = {}
    for frame in clip.frames:
        index = frame.view.index
        places.setdefault(index, []).append(frame.view.camera.position)
        photos[index] = photos.get(index, 0) + (not frame.view.held_out)
    return [DriveStep(index, np.mean(places[index], axis=0), photos[index]) for index in sorted(places)]


def cut_clip(clip: Clip, piece: Piece) -> Clip:
    """Cut the photos, sweeps and tracks of a piece out of a clip, in the same coordinates and times.

    Tracks keep their whole length, so that what moves anywhere moves in every piece; those that exist at no time of
    the piece are left out. Notes on the whole clip are, too.
    """
    frames = tuple(frame for frame in clip.frames if piece.first <= frame.view.index <= piece.last)
    return replace(
        clip,
        frames=frames,
        sweeps=tuple(sweep for sweep in clip.sweeps if piece.first <= sweep.index <= piece.last),
        tracks=choose_present_tracks(clip.tracks, clip, piece),
        exact_tracks=choose_present_tracks(clip.exact_tracks, clip, piece),
        notes=(),
    )


def choose_present_tracks(tracks: Sequence[Track], clip: Clip, piece: Piece) -> tuple[Track, ...]:
    """Choose the tracks that exist at some time step of a piece, in their order."""
    times = {frame.view.time for frame in clip.frames if piece.first <= frame.view.index <= piece.last}
    return tuple(track for track in tracks if any(track.covers(time) for time in times))
