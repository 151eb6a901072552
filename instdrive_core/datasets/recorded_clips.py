"""Clips out of recordings: the asked part, at the asked size, relative to an origin, with what is missing said."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from jaxtyping import Bool, UInt8
from numpy import ndarray

from instdrive_core.datasets.clip import (
    Clip,
    ClipOptions,
    Frame,
    SparsePoints,
    Sweep,
    SweepPoints,
    choose_origin,
    is_held_out,
)
from instdrive_core.datasets.distortion import find_covered_pixels, undistort
from instdrive_core.datasets.fisheye import Fisheye, choose_pinhole
from instdrive_core.datasets.frame_range import build_range_test, describe_steps
from instdrive_core.datasets.photos import decode_photo
from instdrive_core.datasets.posed_photos import DEFAULT_WIDTH, check_field, choose_cameras, describe_start
from instdrive_core.datasets.recording import Lens, RecordedPhoto, RecordedSweep, Recording
from instdrive_core.errors import DataError, OptionError
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.track import Track

logger = logging.getLogger(__name__)

MOVING_EXTENT = 1.0
"""Metres: what gets farther than this from where it was is moving; annotators' jitter adds up to more over a log."""


def build_recorded_clip(recording: Recording, options: ClipOptions) -> Clip:
    """Build the asked part of a recording as a clip; photos and sweeps are read when asked for.

    Raises DataError where the recording has no photo, OptionError for an unknown camera, an empty frame range or an
    unusable scale.
    """
    if options.scale is not None and not 0 < options.scale <= 1:
        raise OptionError(f"scale is {options.scale}; give a number above 0 and up to 1, e.g. 0.25")
    check_field(options)
    if not recording.photos:
        raise DataError(recording.root, "holds no photo", "Get the data set's photos, too")
    lenses = {name: _straighten(lens, options) for name, lens in recording.lenses.items()}
    present = tuple(name for name in recording.lenses if any(photo.camera == name for photo in recording.photos))
    names = choose_cameras(recording.root, present, options.cameras)
    is_asked = build_range_test(options, recording.step_times)
    photos = [photo for photo in recording.photos if photo.camera in names and is_asked(photo.step)]
    if not photos:
        times = {photo.step: recording.step_times[photo.step] for photo in recording.photos}
        raise OptionError(f"{recording.root}: no photo lies in the chosen frames; there are {describe_steps(times)}")
    photos.sort(key=lambda photo: (photo.step, names.index(photo.camera)))
    used = tuple(name for name in names if any(photo.camera == name for photo in photos))
    notes = [f"{name} has no photo of the chosen frames; going on without it" for name in names if name not in used]
    for note in notes:
        logger.warning("%s: %s", recording.root, note)
    first, last = photos[0].step, photos[-1].step
    places = [photo.world_from_camera[:3, 3] for photo in photos if photo.camera == used[0]]
    origin, start = choose_origin(np.stack(places)), min(recording.step_times.values())
    scale = options.scale or min(1.0, DEFAULT_WIDTH / lenses[used[0]].camera.width)
    hide = _build_hiding(scale)
    sweeps = tuple(
        Sweep(sweep.step, recording.step_times[sweep.step] - start, partial(_load_sweep, sweep, origin, start))
        for sweep in sorted(recording.sweeps, key=lambda sweep: sweep.step)
        if first <= sweep.step <= last
    )
    span = recording.step_times[first] - start, recording.step_times[last] - start
    moved = (_move_track(track, origin, start, span) for track in recording.tracks)
    return Clip(
        path=str(recording.root),
        name=recording.name,
        origin=origin,
        frames=tuple(
            _build_frame(photo, lenses[photo.camera], recording.step_times[photo.step] - start, origin, hide)
            for photo in photos
        ),
        sweeps=sweeps,
        tracks=tuple(track for track in moved if track is not None),
        class_names={},
        camera_names=used,
        points=None if sweeps else SparsePoints.none(),
        notes=(*notes, *recording.notes, *(() if sweeps else (describe_start(0),))),
    )


def _straighten(lens: Lens, options: ClipOptions) -> Lens:
    """A fisheye's lens with the pinhole that takes its place; others as they are."""
    if not isinstance(lens.distortion, Fisheye):
        return lens
    camera, distortion = choose_pinhole(lens.camera, lens.distortion, options.fisheye_field)
    return replace(lens, camera=camera, distortion=distortion)


Hiding = Callable[[Lens], tuple[Camera, Bool[ndarray, "h w"] | None]]


def _build_hiding(scale: float) -> Hiding:
    """Build a function for a lens's camera at the clip's scale and the pixels that train; photos share one mask."""

    @lru_cache(maxsize=64)
    def find_once(key: int) -> tuple[Camera, Bool[ndarray, "h w"] | None]:
        lens = known[key]
        camera = lens.camera.scale(scale)
        if lens.distortion.is_pinhole and not lens.hidden:
            return camera, None
        valid = np.ones((camera.height, camera.width), bool)
        if not lens.distortion.is_pinhole:
            valid = find_covered_pixels(camera, lens.distortion)
        if lens.hidden:
            valid[camera.height - math.ceil(camera.height * lens.hidden) :] = False
        return camera, valid

    known: dict[int, Lens] = {}

    def find(lens: Lens) -> tuple[Camera, Bool[ndarray, "h w"] | None]:
        known[id(lens)] = lens
        return find_once(id(lens))

    return find


def _build_frame(photo: RecordedPhoto, lens: Lens, time: float, origin: ndarray, hide: Hiding) -> Frame:
    scaled, valid = hide(lens)
    pose = photo.world_from_camera.copy()
    pose[:3, 3] -= origin
    camera = replace(scaled, world_from_camera=pose)
    view = CameraView(camera, photo.camera, photo.step, time, str(photo.name), is_held_out(photo.step))
    return Frame(view, partial(_load_photo, photo, lens, camera), valid)


def _load_photo(photo: RecordedPhoto, lens: Lens, camera: Camera) -> UInt8[ndarray, "h w 3"]:
    size = lens.camera.width, lens.camera.height
    image = decode_photo(photo.name, photo.open, size, (camera.width, camera.height))
    return image if lens.distortion.is_pinhole else undistort(image, camera, lens.distortion)


def _load_sweep(sweep: RecordedSweep, origin: ndarray, start: float) -> SweepPoints:
    loaded = sweep.load()
    points = (loaded.points - origin).astype(np.float32)
    times = None if loaded.times is None else loaded.times - start
    return SweepPoints(points, loaded.intensity, loaded.sensor, None, None, times)


def _move_track(track: Track, origin: ndarray, start: float, span: tuple[float, float]) -> Track | None:
    """A track relative to origin and start, with the boxes of the span and the next ones beside it; None outside."""
    times = track.times - start
    low = max(int(np.searchsorted(times, span[0] - 1e-3)) - 1, 0)
    high = int(np.searchsorted(times, span[1] + 1e-3)) + 1
    times, poses = times[low:high], track.world_from_box[low:high].copy()
    if not len(times) or times[-1] < span[0] - 1e-3 or times[0] > span[1] + 1e-3:
        return None
    poses[:, :3, 3] -= origin
    extent = float(np.linalg.norm(np.ptp(poses[:, :3, 3], axis=0)))
    return Track(track.id, track.label, track.dimensions, times, poses, extent > MOVING_EXTENT)
