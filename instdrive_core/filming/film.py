"""Films along a camera path: numbered PNG frames, or a video."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError, OptionError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.atomic import open_atomically
from instdrive_core.filming.camera_path import CameraPath
from instdrive_core.progress import report
from instdrive_core.rasterize.pictures import Mode, colorize_depth, colorize_preview, measure_depth_range
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.scene import Scene

FILM_MODES: dict[Mode, str] = {"color": "Colour", "instance": "Instances", "depth": "Depth"}
"""What a film can show, and what the user reads for it."""
CODECS = {".mp4": ("libx264", {"crf": "18"}), ".webm": ("libvpx-vp9", {"crf": "28", "b": "0"})}
"""Encoder and its options by the ending of the video."""
LARGEST, FASTEST, MOST_FRAMES = 8192, 240.0, 100_000
_OTHER_KIND = "Choose the other ending, or frames as PNG"
_DEPTH_SAMPLES, _DEPTH_SIZE = 5, 160

Frame = UInt8[ndarray, "h w 3"]


@dataclass(frozen=True)
class FilmSettings:
    """What each frame shows, and how large and how often."""

    width: int = 1280
    height: int = 720
    rate: float = 30.0
    """Frames per second."""
    mode: Mode = "color"


def check_film(path: CameraPath, settings: FilmSettings, out: Path) -> int:
    """Check that a film can be made, and count its frames. Raises OptionError that names what cannot be."""
    for name, side in (("width", settings.width), ("height", settings.height)):
        if not 1 <= side <= LARGEST:
            raise OptionError(f"the {name} is {side}; it must be from 1 to {LARGEST} pixels")
        if side % 2 and out.suffix.lower() in CODECS:
            raise OptionError(f"the {name} is {side}; a video needs an even number of pixels. Choose {side + 1}")
    if not (math.isfinite(settings.rate) and 1 <= settings.rate <= FASTEST):
        raise OptionError(f"the rate is {settings.rate:g} frames per second; it must be from 1 to {FASTEST:g}")
    if settings.mode not in FILM_MODES:
        raise OptionError(f"a film cannot show {settings.mode!r}; choose {', '.join(FILM_MODES)}")
    count = math.floor((path.end - path.start) * settings.rate + 1e-6) + 1
    if count > MOST_FRAMES:
        raise OptionError(f"the film would have {count:,} frames; at most {MOST_FRAMES:,} are possible")
    return count


def draw_film(
    scene: Scene, path: CameraPath, settings: FilmSettings, count: int, drawn: Bool[ndarray, " n"] | None = None
) -> Iterator[Frame]:
    """Draw the frames one by one, reporting progress; the colours of depth mean the same in all of them."""
    ramp = _measure_depths(scene, path, settings, drawn) if settings.mode == "depth" else None
    for number in range(count):
        report(number / count)
        at = path.start + number / settings.rate
        camera = path.find_camera(at, settings.width, settings.height)
        shown = view_scene(scene, camera, path.find_drive_time(at), drawn)
        if ramp is not None:
            yield colorize_depth(shown.depth, shown.alpha >= 0.5, ramp)
        else:
            yield colorize_preview(scene, shown, settings.mode)


def write_film(
    out: Path, scene: Scene, path: CameraPath, settings: FilmSettings, drawn: Bool[ndarray, " n"] | None = None
) -> int:
    """Write a film of the `drawn` splats as .mp4, .webm, or a new folder of ``frame_00001.png`` …; counts the frames.

    A film that is cancelled or fails leaves nothing behind. Videos hold colours nearly, PNG exactly: only there can
    IDs be read back from colours.

    Raises OptionError where it cannot be made so, DataError where it cannot be written, MissingExtraError for a video
    without PyAV.
    """
    count = check_film(path, settings, out)
    if out.suffix.lower() in CODECS:
        with _open_video(out, settings) as add:
            for frame in draw_film(scene, path, settings, count, drawn):
                add(frame)
        return count
    if out.suffix:
        raise OptionError(f"{out} ends neither in .mp4 nor in .webm; frames as PNG need a folder's name without a dot")
    if out.is_dir() and any(out.iterdir()):
        raise DataError(out, "the folder is not empty, and frames of two films would mix", "Name a new folder")
    _write_frames(out, draw_film(scene, path, settings, count, drawn))
    return count


def _write_frames(folder: Path, frames: Iterator[Frame]) -> None:
    written: list[Path] = []
    is_new = not folder.exists()
    try:
        for number, frame in enumerate(frames, 1):
            name = folder / f"frame_{number:05d}.png"
            with open_atomically(name) as file:
                Image.fromarray(frame).save(file, format="PNG", compress_level=3)
            written.append(name)
    except BaseException:
        for name in written:
            name.unlink(missing_ok=True)
        if is_new and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise


@contextmanager
def _open_video(out: Path, settings: FilmSettings) -> Iterator[Callable[[Frame], None]]:
    """Open a video and give what adds a frame to it; the file is there when the block ends without an error."""
    try:
        import av
        from av.error import FFmpegError
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
    codec, options = CODECS[out.suffix.lower()]
    with open_atomically(out) as file:
        try:
            with av.open(file, "w", format=out.suffix.lower()[1:]) as container:
                try:
                    stream: Any = container.add_stream(codec, rate=Fraction(settings.rate).limit_denominator(1001))
                except ValueError as error:  # this build of PyAV lacks the encoder
                    raise DataError(out, f"the video cannot be encoded ({error})", _OTHER_KIND) from error
                stream.width, stream.height, stream.pix_fmt = settings.width, settings.height, "yuv420p"
                stream.options = options

                def add(frame: Frame) -> None:
                    picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
                    container.mux(stream.encode(picture))

                yield add
                container.mux(stream.encode())
        except FFmpegError as error:
            raise DataError(out, f"the video cannot be encoded ({error})", _OTHER_KIND) from error


def _measure_depths(
    scene: Scene, path: CameraPath, settings: FilmSettings, drawn: Bool[ndarray, " n"] | None
) -> tuple[float, float]:
    """Depths (metres) at the ends of the ramp, from small pictures all along the path."""
    ranges = []
    factor = min(1.0, _DEPTH_SIZE / max(settings.width, settings.height))
    for at in np.linspace(path.start, path.end, _DEPTH_SAMPLES).tolist():
        camera = path.find_camera(at, settings.width, settings.height).scale(factor)
        shown = view_scene(scene, camera, path.find_drive_time(at), drawn)
        found = measure_depth_range(shown.depth, shown.alpha >= 0.5)
        if found is not None:
            ranges.append(found)
    return (min(near for near, _ in ranges), max(far for _, far in ranges)) if ranges else (1.0, 1.0)
