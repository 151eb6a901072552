"""Pipes and devices under the names of files: they would keep a reader waiting, or never end."""

import os
from pathlib import Path

import pytest
from random_scene import random_scene

from instdrive_core.datasets.colmap import binary as colmap_binary
from instdrive_core.datasets.colmap import text as colmap_text
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.point_cloud import read_point_ply
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json
from instdrive_core.files.restricted_pickle import read_pickle
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.masks.imported.label_map import read_imported_label_map
from instdrive_core.masks.imported.npz import read_imported_npz
from instdrive_core.masks.label_map_folder import read_sky_mask
from instdrive_core.project.open import open_document

PIPE = "a pipe, socket or device"
pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


@pytest.mark.parametrize("make", [make_pipe, make_endless])
@pytest.mark.parametrize(
    "name", ["a.ply", "a.compressed.ply", "a.splat", "a.spz", "a.sog", "scene.json", "meta.json", "a.instdrive"]
)
def test_scenes_and_projects(tmp_path: Path, make, name: str) -> None:
    make(tmp_path / name)
    for opened in (open_document, *([open_scene] if not name.endswith(".instdrive") else [])):
        with pytest.raises(DataError, match=f"{PIPE}|holds no"):
            opened(tmp_path / name)


@pytest.mark.parametrize("make", [make_pipe, make_endless])
def test_arrays_of_a_scene_folder(tmp_path: Path, make) -> None:
    save_scene(tmp_path, random_scene(count=5, actors=0))
    arrays = next(tmp_path.glob("*.safetensors"))
    arrays.unlink()
    make(arrays)
    with pytest.raises(DataError, match=PIPE):
        open_document(tmp_path)


@pytest.mark.parametrize("make", [make_pipe, make_endless])
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("transforms.json", read_json),
        ("images.bin", colmap_binary.read_images),
        ("points3D.txt", colmap_text.read_points),
        ("points.ply", read_point_ply),
        ("00.pkl", read_pickle),
        ("00.pkl.gz", read_pickle),
        ("00.jpg", read_photo_size),
        ("masks.npz", lambda path: read_imported_npz(path, 4, 3)),
        ("labels.png", lambda path: read_imported_label_map(path, 4, 3)),
        ("sky.png", read_sky_mask),
    ],
)
def test_files_of_clips_and_masks(tmp_path: Path, make, name: str, read) -> None:
    make(tmp_path / name)
    with pytest.raises(DataError, match=PIPE):
        read(tmp_path / name)
