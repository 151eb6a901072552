"""``instdrive render``: pictures of a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.cli.arguments import check_known_ids, choose_time, find_named_view
from instdrive_core.cli.share_progress import show_share
from instdrive_core.errors import OptionError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.filming.camera_path import CameraPath
from instdrive_core.filming.film import FilmSettings, check_film, write_film
from instdrive_core.filming.path_file import read_camera_path, read_stored_path
from instdrive_core.project.open import open_edited_scene, read_project_view
from instdrive_core.project.save import is_project
from instdrive_core.rasterize.pictures import Mode, colorize_preview
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.wording import format_count

DEFAULT_WIDTH, DEFAULT_HEIGHT = 1280, 720
MAX_SIDE = 16384


def render_pictures(
    scene: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])],
    view: str | None = None,
    all_views: bool = False,
    path: Path | None = None,
    rate: float | None = None,
    mode: Mode = "color",
    hide: tuple[int, ...] = (),
    time: float | None = None,
    width: int | None = None,
    height: int | None = None,
) -> None:
    """Draw a scene into PNG pictures without a window.

    Args:
        scene: Scene file, run folder, or project; of a project, what its edits made of the scene.
        out: PNG file to write; with --all-views a folder, which gets CAMERA/NN.png; with --path a .mp4 or .webm, or a
            new folder, which gets frame_00001.png and so on.
        view: A photo's camera as CAMERA/INDEX, or `orbit` for one that sees the whole scene; default: the first photo's
            camera, or `orbit` where the scene has none.
        all_views: Draw the view of every photo.
        path: Film along the camera path of this project, or of a .json that the editor exported.
        rate: Frames per second of a film; default: 30.
        mode: `instance` and `codeword` pictures hold exact IDs: `instances.colormap.ids_from_colors` reads them back.
        hide: IDs of instances to leave out.
        time: Seconds into the drive at which moving objects are shown; default: the photo's.
        width: Pixels; default: the photo's, or following --height.
        height: Pixels; default: the photo's, or following --width.
    """
    if all_views and view is not None:
        raise OptionError(f"--all-views and --view {view} exclude each other; give one of them")
    if path is not None:
        if view is not None or all_views or time is not None:
            raise OptionError("--path says where the camera is and when; leave out --view, --all-views and --time")
        size = DEFAULT_WIDTH if width is None else width, DEFAULT_HEIGHT if height is None else height
        _render_film(scene, path, out, FilmSettings(*size, 30.0 if rate is None else rate, mode), hide)
        return
    if rate is not None:
        raise OptionError(f"--rate {rate:g} is that of a film; say with --path where the camera goes, or leave it out")
    opened = open_edited_scene(scene)
    drawn = ~np.isin(opened.instance_ids, check_known_ids(hide, opened.table))
    shots = _list_shots(opened, out) if all_views else [(_choose_camera_and_time(opened, view, time), _check_png(out))]
    for (camera, its_time), path in shots:
        shown_at = its_time if time is None else choose_time(opened, time)
        shown = view_scene(opened, _resize_camera(camera, width, height), shown_at, drawn)
        _save_png(path, colorize_preview(opened, shown, mode))
        print(path)


def _render_film(scene: Path, path: Path, out: Path, settings: FilmSettings, hide: tuple[int, ...]) -> None:
    """Draw the frames of a film; nothing is read of the scene where the film cannot be made."""
    keys = read_stored_path(path, read_project_view(path)) if is_project(path) else read_camera_path(path)
    film = CameraPath(keys)
    check_film(film.end - film.start, settings, out)
    opened = open_edited_scene(scene)
    drawn = ~np.isin(opened.instance_ids, check_known_ids(hide, opened.table))
    with show_share(f"film of {film.end - film.start:.1f} s"):
        count = write_film(out, opened, film, settings, drawn)
    print(f"{out}: {format_count(count, 'frame')}")


def place_orbit_camera(scene: Scene, time: float) -> Camera:
    """A camera above and beside the scene that sees most of its opaque Gaussians."""
    poses, present = scene.find_node_poses(time)
    means, _ = place_in_world(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
    solid = (scene.gaussians.opacities > 0.3) & (present[scene.nodes] != 0) & np.isfinite(means).all(axis=1)
    points = means[solid].astype(np.float64) if solid.any() else np.zeros((1, 3))
    target = np.median(points, axis=0)
    radius = max(float(np.quantile(np.linalg.norm(points - target, axis=1), 0.8)), 0.1)
    position = target + 2.2 * radius * np.array([-0.5, -0.4, 0.77])
    focal = 1.1 * DEFAULT_HEIGHT
    center = (DEFAULT_WIDTH / 2, DEFAULT_HEIGHT / 2)
    return Camera(focal, focal, *center, DEFAULT_WIDTH, DEFAULT_HEIGHT, look_at(position, target))


def _choose_camera_and_time(scene: Scene, name: str | None, time: float | None) -> tuple[Camera, float]:
    if name == "orbit" or (name is None and not scene.views):
        shown = choose_time(scene, time)
        return place_orbit_camera(scene, shown), shown
    view = find_named_view(scene, name) if name is not None else scene.views[0]
    return view.camera, view.time


def _list_shots(scene: Scene, folder: Path) -> list[tuple[tuple[Camera, float], Path]]:
    if not scene.views:
        raise OptionError("the scene keeps no photo cameras, so --all-views draws nothing; use --view orbit")
    if folder.suffix.lower() == ".png":
        raise OptionError(f"--all-views writes many pictures; name a folder instead of {folder}")
    return [((view.camera, view.time), folder / view.name / f"{view.index:02d}.png") for view in scene.views]


def _check_png(path: Path) -> Path:
    if path.suffix.lower() != ".png":
        raise OptionError(f"{path} does not end in .png; IDs are exact in PNG only, so no other format is written")
    return path


def _resize_camera(camera: Camera, width: int | None, height: int | None) -> Camera:
    for name, value in (("width", width), ("height", height)):
        if value is not None and not 1 <= value <= MAX_SIDE:
            raise OptionError(f"--{name} is {value}; it must be from 1 to {MAX_SIDE} pixels")
    if width is None and height is None:
        return camera
    if width is not None and height is not None:
        # The vertical field of view stays; a wider or narrower picture shows more or less at its sides.
        zoom = height / camera.height
        scaled = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom, cy=camera.cy * zoom, height=height)
        return replace(scaled, cx=width / 2 + (camera.cx - camera.width / 2) * zoom, width=width)
    return camera.scale(width / camera.width if width is not None else (height or 1) / camera.height)


def _save_png(path: Path, pixels: UInt8[ndarray, "h w 3"]) -> None:
    with open_atomically(path) as file:
        Image.fromarray(pixels).save(file, format="PNG")
