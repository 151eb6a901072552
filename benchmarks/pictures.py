"""The pictures of README and docs/, remade from runs: `python -m benchmarks.pictures RUN --name pandaset`.

Six cameras of one held-out time step: photo, rendered colour, instance map. With `--session` also the editor's window
and what a scripted session did.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image
from tyro.conf import Positional, arg

from instdrive_core.datasets.clip import Clip, ClipOptions, Frame
from instdrive_core.datasets.registry import load_clip
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.scene import Scene

_ORDER = ("left_camera", "front_left_camera", "front_camera", "front_right_camera", "right_camera", "back_camera")


def clip_of_run(run: Path) -> Clip:
    """The clip that a run was trained on, as it was loaded then."""
    facts = json.loads((run / "run.json").read_text())
    options = {name: facts[name] for name in ("cameras", "scale", "first_frame", "last_frame")}
    return load_clip(facts["clip"], ClipOptions(**options))


def frame_rows(scene: Scene, frame: Frame) -> list[UInt8[ndarray, "h w 3"]]:
    """Photo, rendered colour and instance colours of one frame."""
    seen = view_scene(scene, frame.view.camera, frame.view.time)
    color = (np.clip(seen.color, 0, 1) * 255 + 0.5).astype(np.uint8)
    return [frame.load_image(), color, colors_from_ids(build_instance_map(scene, seen))]


def camera_grid(scene: Scene, frames: list[Frame]) -> UInt8[ndarray, "h w 3"]:
    """Columns are cameras from left to right, rows are photo, colour, instances."""
    ordered = sorted(frames, key=lambda frame: _ORDER.index(frame.view.name))
    columns = [np.concatenate(frame_rows(scene, frame)) for frame in ordered]
    return np.concatenate(columns, axis=1)


def session_strip(session: Path) -> UInt8[ndarray, "h w 3"]:
    """Before, instance map, one car deleted and the hole filled, another recoloured: two by two."""
    names = ("color.png", "id_map.png", "cleaned.png", "recolored.png")
    pictures = [np.asarray(Image.open(session / name).convert("RGB")) for name in names]
    return np.concatenate([np.concatenate(pictures[:2], axis=1), np.concatenate(pictures[2:], axis=1)])


def save_picture(pixels: UInt8[ndarray, "h w 3"], target: Path) -> None:
    """A JPEG of at most 2,400 pixels a side."""
    picture = Image.fromarray(pixels)
    picture.thumbnail((2400, 2400), Image.Resampling.LANCZOS)
    target.parent.mkdir(parents=True, exist_ok=True)
    picture.save(target, quality=88)


def main(
    run: Positional[Path] = Path("runs/demo/run"),
    name: str = "demo",
    out: Annotated[Path, arg(aliases=["-o"])] = Path("docs/images"),
    step: int | None = None,
    session: Path | None = None,
) -> None:
    """Draw a run's six-camera grid and a session's pictures.

    Args:
        run: Folder of a finished run.
        name: First part of the picture's file name.
        out: Folder of the pictures.
        step: Time step; default: the first held-out one.
        session: Folder of a scripted session.
    """
    scene, clip = read_scene_folder(run), clip_of_run(run)
    frames = [frame for frame in clip.frames if frame.view.index == step] if step is not None else []
    if not frames:
        held_out = clip.held_out_frames
        frames = [frame for frame in held_out if frame.view.index == held_out[0].view.index]
    written = [out / f"{name}_six_cameras.jpg"]
    save_picture(camera_grid(scene, frames), written[0])
    if session is not None:
        written += [out / "editor.png", out / f"{name}_session.jpg"]
        shutil.copyfile(session / "editor.png", written[1])
        save_picture(session_strip(session), written[2])
    print(json.dumps({"pictures": [str(path) for path in written], "run": str(run), "step": frames[0].view.index}))


if __name__ == "__main__":
    tyro.cli(main)
