"""Films along a camera path: numbered PNG frames, or a video."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import OptionError
from instdrive_core.files.new_folder import fill_new_folder
from instdrive_core.filming.camera_path import CameraPath
from instdrive_core.filming.video import CODECS, Frame, load_av, open_video
from instdrive_core.progress import report
from instdrive_core.rasterize.pictures import Mode, colorize_depth, colorize_preview, measure_depth_range
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import phrase

FILM_MODES: dict[Mode, str] = {"color": phrase("Colour"), "instance": phrase("Instances"), "depth": phrase("Depth")}
"""What a film can show, and what the user reads for it."""
LARGEST, FASTEST, MOST_FRAMES = 8192, 240.0, 100_000
_DEPTH_SAMPLES, _DEPTH_SIZE = 5, 160


@dataclass(frozen=True)
class FilmSettings:
    """What each frame shows, and how large and how often."""

    width: int = 1280
    height: int = 720
    rate: float = 30.0
    """Frames per second."""
    mode: Mode = "color"


def check_film(seconds: float, settings: FilmSettings, out: Path) -> int:
    """Check that a film of so many seconds can be made, and count its frames.

    Raises OptionError that names what cannot be, MissingExtraError for a video without PyAV.
    """
    is_video = out.suffix.lower() in CODECS
    if out.suffix and not is_video:
        raise OptionError(f"{out} ends neither in .mp4 nor in .webm; frames as PNG need a folder's name without a dot")
    for name, side in (("width", settings.width), ("height", settings.height)):
        if not 1 <= side <= LARGEST:
            raise OptionError(f"the {name} is {side}; it must be from 1 to {LARGEST} pixels")
        if side % 2 and is_video:
            raise OptionError(f"the {name} is {side}; a video needs an even number of pixels. Choose {side + 1}")
    if not (math.isfinite(settings.rate) and 1 <= settings.rate <= FASTEST):
        raise OptionError(f"the rate is {settings.rate:g} frames per second; it must be from 1 to {FASTEST:g}")
    if settings.mode not in FILM_MODES:
        raise OptionError(f"a film cannot show {settings.mode!r}; choose {', '.join(FILM_MODES)}")
    count = math.floor(seconds * settings.rate + 1e-6) + 1
    if count > MOST_FRAMES:
        raise OptionError(f"the film would have {count:,} frames; at most {MOST_FRAMES:,} are possible")
    if is_video:
        load_av()
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
    count = check_film(path.end - path.start, settings, out)
    frames = draw_film(scene, path, settings, count, drawn)
    if out.suffix:
        with open_video(out, settings.width, settings.height, settings.rate) as add:
            for frame in frames:
                add(frame)
        return count
    with fill_new_folder(out) as folder:
        for number, frame in enumerate(frames, 1):
            Image.fromarray(frame).save(folder / f"frame_{number:05d}.png", compress_level=3)
    return count


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
