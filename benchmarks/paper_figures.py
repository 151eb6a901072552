"""The paper's figures, drawn from finished runs: camera grid, LiDAR points by ID, single instances cut out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, UInt8, UInt32
from numpy import ndarray
from scipy.ndimage import binary_dilation

from benchmarks.picture_layout import banner, beside, fit_picture, save_jpeg
from instdrive_core.baselines.codeword_instances import assign_instances_by_codeword
from instdrive_core.datasets.clip import Clip, Frame, Sweep, is_held_out
from instdrive_core.errors import DataError
from instdrive_core.evaluation.metrics.point_ids import compute_point_support, vote_point_ids
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.masks.ground_truth import GroundTruth, open_ground_truth
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.scene import Scene

_GRID = (
    ("front_left_camera", "front_camera", "front_right_camera"),
    ("left_camera", "back_camera", "right_camera"),
)
_TITLES = {
    "gaussian-grouping": "Gaussian Grouping",
    "opengaussian": "OpenGaussian",
    "instdrive": "ours",
    "instdrive+losses": "our losses",
    "instdrive+losses+no-voxel": "our losses without voxel",
}
_LAMP_HEIGHT, _LAMP_SLENDER = 5.0, 2.0
"""Metres, and height ÷ width in a photo, of a lamp post at least."""
_NO_INSTANCE = np.uint8(205)


@dataclass(frozen=True)
class Shown:
    """A run in a figure. Baselines are drawn as published."""

    method: str
    variant: str
    run: Path

    @property
    def title(self) -> str:
        """For readers."""
        name = self.method + (f"+{self.variant}" if self.variant else "")
        return _TITLES.get(name, name)

    def scene(self) -> Scene:
        """Its Gaussians with the instances that the figure shows."""
        scene = read_scene_folder(self.run)
        return scene if self.method == "instdrive" else assign_instances_by_codeword(scene)


def draw(figure: str, clip: Clip, shown: Sequence[Shown], target: Path) -> str:
    """Draw a figure into a JPEG and return its caption. Raises DataError where the clip has nothing held out."""
    picture, caption = _FIGURES[figure](clip, shown)
    save_jpeg(picture, target)
    return caption


# Cameras: photo, OpenGaussian, ours, two rows of three each; Gaussian Grouping's front.


def camera_grid(clip: Clip, shown: Sequence[Shown]) -> tuple[UInt8[ndarray, "h w 3"], str]:
    """All cameras of the middle held-out time step. `shown`: Gaussian Grouping, OpenGaussian, ours."""
    frames = {frame.view.name: frame for frame in _middle(clip)}
    grouping, opengaussian, ours = shown
    blocks = [_draw_titled_grid("photo", frames, lambda frame: frame.load_image())]
    fronts = []
    for each in (grouping, opengaussian, ours):
        scene = each.scene()
        if each is not grouping:
            blocks.append(_draw_titled_grid(each.title, frames, lambda frame, scene=scene: id_picture(scene, frame)))
        front = frames.get("front_camera", next(iter(frames.values())))
        fronts.append(banner(id_picture(scene, front), f"front: {each.title}"))
    blocks.append(beside(fronts))
    step = next(iter(frames.values())).view.index
    caption = (
        f"{clip.name}, held-out time step {step}, six cameras: photo, OpenGaussian (as published), ours; "
        "last row the front camera with Gaussian Grouping, OpenGaussian (both as published) and ours. "
        "Colours stand for instance IDs, darkened by the photo; IDs of different methods have nothing in common."
    )
    return np.concatenate(blocks), caption


def id_picture(scene: Scene, frame: Frame) -> UInt8[ndarray, "h w 3"]:
    """Instance colours as a click sees them, shaded by the photo so that shapes can be told."""
    seen = view_scene(scene, frame.view.camera, frame.view.time)
    colors = colors_from_ids(build_instance_map(scene, seen)).astype(np.float32)
    gray = frame.load_image().mean(axis=-1, keepdims=True, dtype=np.float32) / 255
    return (colors * (0.6 + 0.4 * gray)).astype(np.uint8)


def _draw_titled_grid(
    title: str, frames: dict[str, Frame], picture: Callable[[Frame], UInt8[ndarray, "h w 3"]]
) -> UInt8[ndarray, "h w 3"]:
    first = next(iter(frames.values())).view.camera
    blank = np.full((first.height, first.width, 3), 255, np.uint8)
    rows = [beside([picture(frames[name]) if name in frames else blank for name in row]) for row in _GRID]
    return banner(np.concatenate(rows), title)


# LiDAR points coloured by ID.


def lidar_by_id(clip: Clip, shown: Sequence[Shown]) -> tuple[UInt8[ndarray, "h w 3"], str]:
    """The middle held-out sweep seen from above and behind the car, once for each run, and the truth where known."""
    sweeps = [sweep for sweep in clip.sweeps if is_held_out(sweep.index)]
    if not sweeps:
        raise DataError(clip.path, "no held-out time step has a sweep", "Use a clip whose LiDAR covers one.")
    sweep = sweeps[len(sweeps) // 2]
    camera = _bird(clip, sweep)
    swept = sweep.load()
    ids = {each.title: ids_of_points(each.scene(), sweep.time, swept.points) for each in shown}
    if swept.instance_labels is not None:
        ids["ground truth"] = swept.instance_labels
    panels = [banner(point_picture(swept.points, each, camera), title) for title, each in ids.items()]
    blank = np.full_like(panels[0], 255)
    panels += [blank] * (len(panels) % 2)
    rows = [beside(panels[number : number + 2]) for number in range(0, len(panels), 2)]
    caption = (
        f"{clip.name}, LiDAR points of held-out time step {sweep.index}, coloured by the ID that they take from nearby "
        f"Gaussians: {', '.join(ids)} (baselines as published). Grey: none."
    )
    return np.concatenate(rows), caption


def _bird(clip: Clip, sweep: Sweep, width: int = 960, height: int = 640) -> Camera:
    """A camera 16 m above and 22 m behind the first camera of the sweep's time step."""
    frame = min(clip.frames, key=lambda each: abs(each.view.index - sweep.index))
    ego = frame.view.camera
    ahead = ego.world_from_camera[:3, 2] * np.array([1, 1, 0])
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    pose = look_at(ego.position - 22 * ahead + np.array([0, 0, 16.0]), ego.position + 14 * ahead)
    return Camera(0.8 * width, 0.8 * width, width / 2, height / 2, width, height, pose)


def ids_of_points(scene: Scene, time: float, points: Float32[ndarray, "n 3"]) -> UInt32[ndarray, " n"]:
    """The ID that each point has, as the evaluation sees it; 0 = none."""
    return vote_point_ids(compute_point_support(scene, points, time), scene.instance_ids).ids.astype(np.uint32)


def point_picture(
    points: Float32[ndarray, "n 3"], ids: UInt32[ndarray, " n"], camera: Camera
) -> UInt8[ndarray, "h w 3"]:
    """Points as squares of 2 pixels in the colours of their IDs, near ones in front."""
    picture = np.full((camera.height, camera.width, 3), 255, np.uint8)
    pixels, depths = camera.project(points)
    colors = np.where(ids[:, None] > 0, colors_from_ids(ids), _NO_INSTANCE)
    columns, lines = np.floor(pixels).astype(np.int64).T
    inside = (depths > 1) & (columns >= 0) & (lines >= 0)
    inside &= (columns < camera.width - 1) & (lines < camera.height - 1)
    order = np.flatnonzero(inside)[np.argsort(-depths[inside], kind="stable")]
    for down in (0, 1):
        for right in (0, 1):
            picture[lines[order] + down, columns[order] + right] = colors[order]
    return picture


# Single instances, cut out of the scene.


@dataclass(frozen=True)
class Subject:
    """An object in a held-out view."""

    title: str
    frame: Frame
    mask: Bool[ndarray, "h w"]


def cutouts(clip: Clip, shown: Sequence[Shown]) -> tuple[UInt8[ndarray, "h w 3"], str]:
    """What a click on a lamp, a sign, a building and the road selects, alone; above it the photo, object outlined."""
    scene = shown[0].scene()
    subjects = list(_subjects(scene, clip, open_ground_truth(clip)))
    if not subjects:
        raise DataError(clip.path, "no held-out view shows a lamp, sign, building or road", "Use a longer clip.")
    columns = []
    for subject in subjects:
        window = _window(subject.mask)
        photo = _outline(subject.frame.load_image(), subject.mask)[window]
        alone = _alone(scene, subject)[window]
        columns.append(
            banner(np.concatenate([fit_picture(photo, 360, 270), fit_picture(alone, 360, 270)]), subject.title)
        )
    titles = ", ".join(subject.title for subject in subjects)
    caption = (
        f"{clip.name}: {titles}. Above, held-out photos with the object outlined; below, the instance that most of its "
        f"pixels show, drawn alone ({shown[0].title})."
    )
    return beside(columns), caption


def _subjects(scene: Scene, clip: Clip, truth: GroundTruth) -> Iterator[Subject]:
    """For each kind the object with the largest mask; masks that the photo's border cuts count a tenth.

    No class tells lamps from bins: a lamp is a slender static object as tall as one.
    """
    classes = {"lamp": "Other Static Object", "sign": "Signs", "building": "Building", "road": "Road"}
    best: dict[str, tuple[float, Subject]] = {}
    for frame in clip.held_out_frames:
        labels = truth.load(frame)
        for label in np.unique(labels[labels > 0]).tolist():
            mask = labels == label
            score = float(mask.sum()) * (0.1 if _is_cut(mask) else 1.0)
            for title, class_name in classes.items():
                fits = truth.instances[label].class_name == class_name and score > best.get(title, (0.0, None))[0]
                if fits and (title != "lamp" or _is_lamp(scene, frame, mask)):
                    best[title] = score, Subject(title, frame, mask)
    yield from (best[title][1] for title in classes if title in best)


def _is_lamp(scene: Scene, frame: Frame, mask: Bool[ndarray, "h w"]) -> bool:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    depth = float(np.median(view_scene(scene, frame.view.camera, frame.view.time).depth[mask]))
    metres = len(rows) * depth / frame.view.camera.fy
    return len(rows) >= _LAMP_SLENDER * len(columns) and metres >= _LAMP_HEIGHT


def _is_cut(mask: Bool[ndarray, "h w"]) -> bool:
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def _window(mask: Bool[ndarray, "h w"], aspect: float = 4 / 3) -> tuple[slice, slice]:
    """Rows and columns around a mask, 4:3 where the photo is large enough."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    height = min(int(1.4 * max(np.ptp(rows) + 1, (np.ptp(columns) + 1) / aspect)) + 2, mask.shape[0])
    width = min(int(height * aspect), mask.shape[1])
    top = int(np.clip((rows[0] + rows[-1] - height) // 2, 0, mask.shape[0] - height))
    left = int(np.clip((columns[0] + columns[-1] - width) // 2, 0, mask.shape[1] - width))
    return slice(top, top + height), slice(left, left + width)


def _outline(photo: UInt8[ndarray, "h w 3"], mask: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    border = binary_dilation(mask) & ~mask
    return np.where(border[..., None], np.array([255, 40, 40], np.uint8), photo)


def _alone(scene: Scene, subject: Subject) -> UInt8[ndarray, "h w 3"]:
    """The instance that most pixels of the object show, on white."""
    camera, time = subject.frame.view.camera, subject.frame.view.time
    ids = build_instance_map(scene, view_scene(scene, camera, time))[subject.mask]
    selected = np.bincount(ids[ids > 0], minlength=1).argmax() if ids.any() else 0
    drawn = (scene.instance_ids == selected) & (scene.instance_ids > 0)
    seen = view_scene(replace(scene, sky=None), camera, time, drawn)
    return (np.clip(seen.color + 1 - seen.alpha[..., None], 0, 1) * 255 + 0.5).astype(np.uint8)


def _middle(clip: Clip) -> list[Frame]:
    """Frames of the middle held-out time step."""
    held_out = clip.held_out_frames
    if not held_out:
        raise DataError(clip.path, "has no held-out time step", "Use a range of frames that contains one.")
    steps = sorted({frame.view.index for frame in held_out})
    return [frame for frame in held_out if frame.view.index == steps[len(steps) // 2]]


_FIGURES = {"cameras": camera_grid, "lidar": lidar_by_id, "cutouts": cutouts}
