"""``instdrive simulate``: the edited drive recorded again, as sensor data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

import tyro

from instdrive_core.cli.share_progress import show_share
from instdrive_core.progress import report_to
from instdrive_core.recording.depth_files import DepthFormat, check_depth_format
from instdrive_core.recording.drive import open_drive
from instdrive_core.recording.ego_path import parse_ego_change
from instdrive_core.recording.layouts import write_recorded_layout
from instdrive_core.recording.plan import RecordOptions
from instdrive_core.recording.record import record_drive
from instdrive_core.recording.report import describe_confidence
from instdrive_core.recording.shutter import parse_shutter
from instdrive_core.recording.videos import VideoLook, check_video_request, write_recorded_videos
from instdrive_core.wording import format_count

Layout = Literal[
    "pandaset",
    "nuscenes",
    "t4",
    "kitti-tracking",
    "kitti-raw",
    "kitti-360",
    "argoverse",
    "waymo",
    "drivestudio",
    "coco",
    "mcap",
]


def simulate_drive(
    scene: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])],
    cameras: tuple[str, ...] = (),
    first: str | None = None,
    last: str | None = None,
    width: int | None = None,
    expose: bool = False,
    layout: tuple[Layout, ...] = (),
    ego: tuple[str, ...] = (),
    shift: float | None = None,
    flow: bool = False,
    confidence: bool = False,
    depth_format: DepthFormat = "npz",
    lidar: str | None = None,
    ray_drop: bool = False,
    shutter: str | None = None,
    rig: Path | None = None,
    video: tuple[Literal["mp4", "webm"], ...] = (),
    video_shows: tuple[VideoLook, ...] = ("color",),
    progress: Literal["bar", "lines"] = "bar",
) -> None:
    """Record the edited drive as sensor data: pictures, masks, depth and boxes of every camera and moment.

    Stopped at any moment, the same command goes on where it was.

    Args:
        scene: Run or scene folder, or a project on one: what its edits made of the drive.
        out: Folder to record into; new, or one in which the same recording was begun.
        cameras: Only these cameras, e.g. front_camera left_camera.
        first: First time step to record, e.g. 30, or seconds since the drive's first, e.g. 3s.
        last: Last time step or second, inclusive.
        width: Width of the pictures in pixels; default: as in training.
        ego: Change the recording car's way: shift=METRES to the left, lane=METRES@SECONDS or lane=METRES@FROM-TO,
            speed=FACTOR up to 1, stop=SECONDS, path=FILE for a way drawn on the ground, FILE.xosc or FILE.xosc#ENTITY
            for that of an OpenSCENARIO file. Several are done together.
        shift: Short for --ego shift=METRES.
        flow: Record optical flow, too.
        confidence: Record how far each pixel can be trusted, too; on by itself where the car's way is changed.
        depth_format: How depth in metres is written, beside the pictures in millimetres: npz (NumPy) or exr (OpenEXR,
            channel Z).
        lidar: The sensor whose sweeps are recorded, too: own (as the clip's sweeps show it), VLP-16, HDL-64E, OS1-128,
            PANDAR128, a JSON file that describes one, or none. Default: own, where the run's clip has sweeps.
        ray_drop: Let surfaces lose rays as often as in the clip's own sweeps; which ones is drawn anew for each sweep.
        shutter: Record through a rolling shutter: seconds from a picture's first to its last line, such as 0.03; with
            0.03@left the exposed line goes to the left (down, up, left, right; default: down).
        rig: JSON file of the cameras that record instead of the drive's own: those kept, moved or given other lenses,
            and new ones.
        video: Write a video of each camera and one of all cameras, too: mp4 or webm, into OUT/videos.
        video_shows: What videos show: color, instances, depth; each gets videos of its own.
        progress: How progress is shown: as a bar, or in lines `progress 0.25` for other programs.
        layout: Write the recording in layouts of data sets, too, each into OUT/layouts/NAME.
        expose: Give colours the exposures of the training photos; default: the scene's own colours, as in the editor.
    """
    check_video_request(video)
    check_depth_format(depth_format)
    changes = tuple(parse_ego_change(text) for text in (*ego, *(() if shift is None else (f"shift={shift:g}",))))
    part = _read_moment(first), _read_moment(last)
    rolling = None if shutter is None else parse_shutter(shutter)
    drive = open_drive(
        scene,
        RecordOptions(
            cameras, *part, width, expose, flow, changes, confidence, lidar, rolling, rig, ray_drop, depth_format
        ),
    )
    for note in drive.notes:
        print(note)
    show = show_share if progress == "bar" else _print_share
    with show("recording"):
        manifest = record_drive(out, drive)
    opened = {}
    for name in dict.fromkeys(layout):
        with show(name):
            opened[name] = write_recorded_layout(out, name)
    for kind in dict.fromkeys(video):
        with show(f"{kind} videos"):
            write_recorded_videos(out, kind, video_shows)
    boxed = sum(entry["has_box"] for entry in manifest["instances"])
    counts = format_count(len(manifest["views"]), "view"), format_count(len(manifest["moments"]), "moment")
    print(f"{out}: {counts[0]}, {counts[1]}, {format_count(boxed, 'boxed thing')}")
    if manifest["confidence"] is not None:
        print(describe_confidence(manifest["confidence"]))
    if video:
        print(f"videos: {out / 'videos'}")
    for name, place in opened.items():
        print(f"{name}: {place}")


@contextmanager
def _print_share(title: str) -> Iterator[None]:
    """Print a line for every hundredth that is done."""
    last = -1

    def tell(share: float) -> None:
        nonlocal last
        if int(share * 100) != last:
            last = int(share * 100)
            print(f"progress {share:.2f}", flush=True)

    with report_to(tell):
        yield


def _read_moment(text: str | None) -> int | str | None:
    return int(text) if text is not None and text.strip().isdecimal() else text
