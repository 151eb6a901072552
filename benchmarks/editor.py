"""How the editor feels: frames per second, and what each thing that a user does costs the UI's thread.

`python -m benchmarks.editor` prints one JSON line. The session and the view are the editor's own, off screen; the
scene is the common street in its trained state, as a .ply with degree-3 harmonics. Idle CPU and the window's start are
those of the program as a process, on a virtual display where there is no other. On two cores:
`NUMBA_NUM_THREADS=2 taskset -c 0,1 python -m benchmarks.editor`.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.editor_scene import SIZE, write_street, write_tiled_street
from benchmarks.editor_session import driven_editor
from benchmarks.editor_window import help_seconds, window_figures
from benchmarks.own_state import own_state
from instdrive_app.render.offscreen import open_offscreen_context
from instdrive_core.errors import InstDriveError

_STEP = 0.01
"""Metres from frame to frame where each is seen from another place, so that no colour of a splat stays."""


@dataclass(frozen=True)
class Options:
    """Measure the editor."""

    small: int = 200_000
    """Splats of the small scene."""
    large: int = 1_000_000
    """Splats of the large one."""
    huge: int = 5_000_000
    """Splats of a scene that is only opened, looked around in and clicked; 0 leaves it out (1.2 GB of disk)."""
    biggest: int = 0
    """Splats of a scene without harmonics, e.g. 13600000, to be opened, looked around in, clicked, edited; 0 leaves it
    out (a minute, 6 GB of memory and 1 GB of disk)."""
    frames: int = 20
    """Frames timed at full resolution."""
    actions: int = 15
    """Clicks and edits of each kind."""
    moving_seconds: float = 3.0
    """How long the camera turns."""
    window: bool = True
    """Also open a window, for idle CPU and its start."""


def main(options: Options) -> dict[str, float]:
    """Everything the JSON line says."""
    with own_state() as folder:
        figures = {"fps_200k_720p": _small_figures(folder, options)}
        figures |= _large_figures(folder, options)
        if options.huge:
            figures |= _huge_figures(folder, options)
        if options.biggest:
            figures |= _biggest_figures(folder, options)
        figures["help_s"] = help_seconds()
        if options.window:
            small = folder / f"street_{options.small}.ply"
            figures["window_s"], figures["idle_cpu_percent"] = window_figures(small, folder)
    return {name: round(value, 2) for name, value in figures.items()}


def _small_figures(folder: Path, options: Options) -> float:
    path, cameras = write_street(folder, options.small)
    with open_offscreen_context() as context, driven_editor(context, SIZE) as editor:
        editor.open(path)
        editor.look_from(cameras[0])
        editor.settle()
        return editor.fps_still(options.frames)


def _large_figures(folder: Path, options: Options) -> dict[str, float]:
    path, cameras = write_street(folder, options.large)
    with open_offscreen_context() as context, driven_editor(context, SIZE) as editor:
        opened = editor.open(path)
        editor.look_from(cameras[0])
        editor.settle()
        still, elsewhere = editor.fps_still(options.frames), editor.fps_still(options.frames, _STEP)
        editor.fps_moving(options.moving_seconds)  # levels of detail are built meanwhile
        moving, draft = editor.fps_moving(options.moving_seconds), editor.draft_psnr()
        click, edits = editor.click_seconds(options.actions), editor.edit_seconds(options.actions)
        brush, ranged = editor.brush_seconds(options.actions), editor.range_seconds(options.actions)
        exported = editor.export(folder / "exported.ply")
        return {
            "fps_1m_720p": still,
            "fps_1m_720p_elsewhere": elsewhere,
            "fps_1m_720p_moving": moving,
            "draft_psnr_1m": draft,
            "click_ms_1m": 1e3 * click,
            **{f"{name}_ms_1m": 1e3 * seconds for name, seconds in edits.items()},
            "brush_ms_1m": 1e3 * brush,
            "range_ms_1m": 1e3 * ranged,
            "open_s_1m": opened,
            "export_s_1m": exported,
            "max_freeze_ms": 1e3 * editor.longest_freeze,
        }


def _huge_figures(folder: Path, options: Options) -> dict[str, float]:
    path, cameras = write_street(folder, options.huge)
    with open_offscreen_context() as context, driven_editor(context, SIZE) as editor:
        opened = editor.open(path)
        editor.look_from(cameras[0])
        editor.settle()
        editor.fps_moving(2 * options.moving_seconds)  # levels of detail are built meanwhile
        return {
            "fps_5m_720p_moving": editor.fps_moving(options.moving_seconds),
            "draft_psnr_5m": editor.draft_psnr(),
            "click_ms_5m": 1e3 * editor.click_seconds(options.actions),
            "open_s_5m": opened,
        }


def _biggest_figures(folder: Path, options: Options) -> dict[str, float]:
    path, cameras = write_tiled_street(folder, options.biggest)
    with open_offscreen_context() as context, driven_editor(context, SIZE) as editor:
        first, opened = editor.open_sketched(path)
        name = f"{options.biggest // 10**6}m"
        figures = {f"first_picture_s_{name}": first, f"open_s_{name}": opened}
        editor.settle()
        figures[f"first_sharp_s_{name}"] = editor.view.frame_seconds
        figures[f"fps_{name}_720p_moving_at_once"] = editor.fps_moving(options.moving_seconds)
        editor.fps_moving(8 * options.moving_seconds)  # levels of detail are built meanwhile
        figures[f"fps_{name}_720p_moving_all_in_view"] = editor.fps_moving(options.moving_seconds)
        figures[f"draft_psnr_{name}_all_in_view"] = editor.draft_psnr()
        editor.look_from(cameras[0])
        editor.settle()
        return figures | {
            f"fps_{name}_720p_moving": editor.fps_moving(options.moving_seconds),
            f"draft_psnr_{name}": editor.draft_psnr(),
            f"click_ms_{name}": 1e3 * editor.click_seconds(options.actions),
            f"delete_ms_{name}": 1e3 * editor.delete_seconds(options.actions),
        }


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
