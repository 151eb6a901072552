"""A street of Gaussians, photographed by the rasterizer: a scene without instances, photos with poses, and masks."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image
from procedural_street import procedural_street

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import save_scene
from instdrive_core.instances.table import InstanceTable
from instdrive_core.masks.label_map_folder import FrameMasks, write_masks
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import transform_gaussians

WIDTH, HEIGHT, FOCAL = 160, 90, 130.0
PHOTOS = 12
Y_DOWN = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0]])
"""To the file's world, whose y points down, as structure from motion leaves it."""


@dataclass(frozen=True)
class PhotographedStreet:
    """What was written, and the truth."""

    scene: Path
    """A .ply in the file's world, which knows no instances."""
    photos: Path
    """A folder of photos and poses in the same world, with masks."""
    ids: np.ndarray
    """True instance of each row."""


def write_photographed_street(folder: Path, with_masks: bool = True) -> PhotographedStreet:
    """Write scene, photos, poses and masks into a folder."""
    truth = bake_document(Document(procedural_street(0.35)), time=0.0)
    views = tuple(_look(number) for number in range(PHOTOS))
    photos = folder / "photos"
    (photos / "images").mkdir(parents=True)
    maps = []
    for view in views:
        drawn = view_scene(truth, view.camera, 0.0)
        Image.fromarray((np.clip(drawn.color, 0, 1) * 255).round().astype(np.uint8)).save(photos / view.photo)
        maps.append(build_instance_map(truth, drawn))
    _write_poses(photos, views)
    if with_masks:
        _write_masks(load_clip(str(photos), ClipOptions()), maps, photos / "masks")
    _write_bare(truth, folder / "street.ply")
    return PhotographedStreet(folder / "street.ply", photos, truth.instance_ids)


def _look(number: int) -> CameraView:
    eye = np.array([-0.6, -3.0 + 1.6 * number, 1.8])
    camera = Camera(
        FOCAL,
        FOCAL,
        WIDTH / 2,
        HEIGHT / 2,
        WIDTH,
        HEIGHT,
        look_at(eye, eye + np.array([3.0 * (-1) ** number, 9, -1.0])),
    )
    return CameraView(camera, "camera", number, 0.1 * number, f"images/{number:03d}.png")


def _write_poses(photos: Path, views: tuple[CameraView, ...]) -> None:
    turn = np.eye(4)
    turn[:3] = Y_DOWN
    frames = [
        {
            "file_path": view.photo,
            "transform_matrix": (turn @ view.camera.world_from_camera @ np.diag([1, -1, -1, 1])).tolist(),
        }
        for view in views
    ]
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT}
    (photos / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))


def _write_masks(clip: Clip, maps: list[np.ndarray], folder: Path) -> None:
    """Labels mean nothing across photos: each photo has an order of its own."""
    masks = []
    for frame in clip.training_frames:
        ids = maps[frame.view.index]
        known = np.unique(ids[ids > 0])
        labels = np.random.default_rng(frame.view.index).permutation(len(known)) + 1
        table = np.zeros(int(ids.max()) + 1, np.uint16)
        table[known] = labels
        masks.append((frame.key, FrameMasks(table[ids], ids == 0)))
    write_masks(folder, masks, "import", 0)


def _write_bare(truth: Scene, file: Path) -> None:
    nothing = np.zeros(len(truth), np.uint32)
    gaussians = truth.gaussians.copy()
    transform_gaussians(gaussians, Y_DOWN)
    bare = replace(
        truth,
        gaussians=gaussians,
        instance_ids=nothing,
        codewords=nothing.copy(),
        table=InstanceTable(),
        views=(),
        sky=None,
        start=None,
    )
    save_scene(file, bare, sibr=True)
