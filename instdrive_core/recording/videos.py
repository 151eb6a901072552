"""Videos of a finished recording: one of each camera, and one of all side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from instdrive_core.errors import OptionError
from instdrive_core.filming.film import FASTEST
from instdrive_core.filming.video import CODECS, Frame, load_av, open_video
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.progress import report
from instdrive_core.rasterize.pictures import colorize_depth, measure_depth_range
from instdrive_core.recording.depth_files import read_depth
from instdrive_core.recording.folder import name_of_file, read_color, read_id_map, read_manifest

VideoLook = Literal["color", "instances", "depth"]
ALL = "all_cameras"
"""Name of the video of all cameras."""
LARGEST_MOSAIC = 2560
"""Pixels that the video of all cameras is wide at most."""
_DEPTH_SAMPLES = 12
_LABEL_SHARE = 0.06
"""Height of a camera's name as a share of its picture's."""


@dataclass(frozen=True)
class _Strip:
    """The views of one camera, moment by moment."""

    camera: str
    views: tuple[dict[str, Any], ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its frames: even, as encoders need them."""
        first = self.views[0]
        return _round_up(first["width"]), _round_up(first["height"])


def check_video_request(kinds: Sequence[str]) -> None:
    """Check that videos of these endings (mp4, webm) can be written, before an hour of recording.

    Raises OptionError for another ending, MissingExtraError where PyAV is missing.
    """
    for kind in kinds:
        if f".{kind}" not in CODECS:
            raise OptionError(f"a video cannot end in .{kind}; choose mp4 or webm")
    if kinds:
        load_av()


def write_recorded_videos(folder: Path, kind: str, looks: Sequence[VideoLook] = ("color",)) -> list[Path]:
    """Write videos of a finished recording into ``videos/LOOK/CAMERA.KIND``, and of all cameras; returns the files.

    Each is whole or absent, and those that are there already are kept: the pictures of a recording do not change.

    Args:
        folder: of the recording.
        kind: mp4 or webm.
        looks: what they show: colour, instances in the exact colours of their IDs, depth as a ramp.

    Raises DataError where the recording is unfinished or a file cannot be written, OptionError for another kind,
    MissingExtraError without PyAV.
    """
    check_video_request([kind])
    manifest = read_manifest(folder)
    strips = [
        _Strip(camera, tuple(view for view in manifest["views"] if view["camera"] == camera))
        for camera in manifest["cameras"]
    ]
    rate = find_frame_rate([moment["time"] for moment in manifest["moments"]])
    steps = [moment["step"] for moment in manifest["moments"]]
    found = []
    for number, look in enumerate(dict.fromkeys(looks)):
        draw = _make_drawer(folder, look, manifest["views"])
        tasks: list[tuple[str, tuple[int, int], Iterator[Frame]]] = [
            (strip.camera, strip.size, _draw_strip(strip, draw)) for strip in strips
        ]
        if len(strips) > 1:
            tile, columns = _plan_mosaic(strips)
            size = (tile[0] * columns, tile[1] * -(-len(strips) // columns))
            tasks.append((ALL, size, _draw_mosaic(strips, steps, tile, columns, draw)))
        for place, (name, size, frames) in enumerate(tasks):
            report((number + place / len(tasks)) / len(looks))
            out = folder / "videos" / look / f"{name}.{kind}"
            if not out.is_file():
                out.parent.mkdir(parents=True, exist_ok=True)
                with open_video(out, *size, rate) as add:
                    for frame in frames:
                        add(frame)
            found.append(out)
    report(1.0)
    return found


def find_frame_rate(times: Sequence[float]) -> float:
    """Find the frames per second at which moments (seconds, rising) pass as fast as they did."""
    span = times[-1] - times[0] if len(times) > 1 else 0.0
    return min(max((len(times) - 1) / span, 1.0), FASTEST) if span > 0 else 1.0


def _make_drawer(folder: Path, look: VideoLook, views: Sequence[dict[str, Any]]) -> Callable[[dict[str, Any]], Frame]:
    match look:
        case "color":
            return lambda view: read_color(folder / view["color"])
        case "instances":
            return lambda view: colors_from_ids(read_id_map(folder / _name(view, "instances", ".png")))
        case "depth":
            chosen = views[:: max(1, len(views) // _DEPTH_SAMPLES)]
            depths = [read_depth(folder / _name(view, "depth", "")) for view in chosen]
            ranges = [found for each in depths if (found := measure_depth_range(each, each > 0)) is not None]
            ramp = (min(near for near, _ in ranges), max(far for _, far in ranges)) if ranges else (1.0, 1.0)

            def draw(view: dict[str, Any]) -> Frame:
                depth = read_depth(folder / _name(view, "depth", ""))
                return colorize_depth(depth, depth > 0, ramp)

            return draw


def _name(view: dict[str, Any], kind: str, suffix: str) -> str:
    return name_of_file(kind, view["camera"], view["step"], suffix)


def _draw_strip(strip: _Strip, draw: Callable[[dict[str, Any]], Frame]) -> Iterator[Frame]:
    width, height = strip.size
    for view in strip.views:
        frame = draw(view)
        yield np.pad(frame, ((0, height - frame.shape[0]), (0, width - frame.shape[1]), (0, 0)), mode="edge")


def _plan_mosaic(strips: Sequence[_Strip]) -> tuple[tuple[int, int], int]:
    """Width and height of a camera's part, and how many stand side by side."""
    columns = math.ceil(math.sqrt(len(strips)))
    width, height = (max(strip.size[axis] for strip in strips) for axis in range(2))
    factor = min(1.0, LARGEST_MOSAIC / (columns * width))
    return (_round_up(round(width * factor)), _round_up(round(height * factor))), columns


def _draw_mosaic(
    strips: Sequence[_Strip],
    steps: Sequence[int],
    tile: tuple[int, int],
    columns: int,
    draw: Callable[[dict[str, Any]], Frame],
) -> Iterator[Frame]:
    """All cameras with their names; black where one has no picture of a moment."""
    at = [{view["step"]: view for view in strip.views} for strip in strips]
    rows, font = -(-len(strips) // columns), ImageFont.load_default(max(10, round(_LABEL_SHARE * tile[1])))
    for step in steps:
        whole = Image.new("RGB", (tile[0] * columns, tile[1] * rows))
        pen = ImageDraw.Draw(whole)
        for number, (strip, views) in enumerate(zip(strips, at, strict=True)):
            corner = number % columns * tile[0], number // columns * tile[1]
            if step in views:
                picture = Image.fromarray(draw(views[step]))
                factor = min(tile[0] / picture.width, tile[1] / picture.height)
                size = max(1, round(picture.width * factor)), max(1, round(picture.height * factor))
                if size != picture.size:
                    picture = picture.resize(size, Image.Resampling.BILINEAR)
                whole.paste(picture, (corner[0] + (tile[0] - size[0]) // 2, corner[1] + (tile[1] - size[1]) // 2))
            place = corner[0] + round(0.02 * tile[1]), corner[1] + round(0.01 * tile[1])
            pen.text(place, strip.camera, "white", font, stroke_width=1, stroke_fill="black")
        yield np.asarray(whole)


def _round_up(side: int) -> int:
    return side + side % 2
