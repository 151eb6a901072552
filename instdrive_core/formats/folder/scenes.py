"""The native format: a folder with ``scene.json`` and one safetensors file; keeps tracks, cameras, sky and exposures.

The arrays' file is named by its content, and ``scene.json`` names it: replacing ``scene.json`` is the one moment at
which a new scene takes the place of the old, so a reader or a crash finds one of them whole. The folder may hold other
files (a run's checkpoints and logs).
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from safetensors import SafetensorError
from safetensors.numpy import save_file

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import replace_atomically, write_bytes
from instdrive_core.files.json_value import parse_json
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.allocation import WHOLE, ReadOptions
from instdrive_core.formats.folder.arrays import EXTRA, digest_arrays, read_arrays
from instdrive_core.formats.folder.manifest import assemble_scene, build_manifest
from instdrive_core.formats.scene_format import Fidelity, FolderLayout, Format
from instdrive_core.scene.scene import Scene

MANIFEST = "scene.json"
FORMAT_NAME, FORMAT_VERSION = "instdrive scene", 1
_ARRAYS_NAME = re.compile(r"scene\.[0-9a-f]{16}\.safetensors")
_ATTEMPTS = 5
_EXACT = {"means", "instance_ids", "codewords", "nodes"}
"""Arrays that a half-precision scene keeps as they are: float16 metres are centimetres off at 30 m."""


def write_scene_folder(folder: str | Path, scene: Scene, half: bool = False) -> None:
    """Write a scene into a folder, atomically; earlier arrays in it are removed afterwards.

    Args:
        folder: made where missing; photos that share an ancestor with it are stored relative to it, the rest absolute.
        scene: what to write.
        half: store all but positions and IDs as float16, the sky as 8 bits: for a small sample scene.
    """
    folder = Path(folder)
    arrays = {name: np.ascontiguousarray(array) for name, array in _collect_arrays(scene).items()}
    if half:
        arrays = {name: _halve_precision(name, array) for name, array in arrays.items()}
    name = f"scene.{digest_arrays(arrays)}.safetensors"
    is_new = not (folder / name).exists()
    try:
        with replace_atomically(folder / name, temporary_for="scene.safetensors") as temporary:
            save_file(arrays, temporary)
    except SafetensorError as error:
        problem = f"the file cannot be written ({error})"
        raise DataError(folder / name, problem, "Free some space or choose another place") from error
    manifest = {"format": FORMAT_NAME, "version": FORMAT_VERSION, "arrays": name, **build_manifest(scene)}
    for view in manifest["views"]:
        view["photo"] = _relativize_photo(view["photo"], folder)
    try:
        write_bytes(folder / MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode())
    except DataError:
        if is_new:
            (folder / name).unlink(missing_ok=True)
        raise
    for old in folder.glob("scene.*.safetensors"):
        if old.name != name and _ARRAYS_NAME.fullmatch(old.name):
            old.unlink(missing_ok=True)


def read_scene_folder(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Read what `write_scene_folder` wrote. Raises DataError where a part is missing or damaged.

    Args:
        path: the folder, or its manifest, which may still have the temporary name that it is written under.
        options: which rows are kept.
    """
    path = Path(path)
    folder, manifest_name = (path, MANIFEST) if path.is_dir() or not path.is_file() else (path.parent, path.name)
    manifest, arrays, digest = _read_parts(folder, manifest_name, options)
    if f"scene.{digest}.safetensors" != manifest["arrays"]:
        problem = "the arrays are not those that were saved: their SHA-256 is not the one in the file's name"
        raise DataError(folder / manifest["arrays"], problem, "Copy the folder again, or restore it")
    try:
        for view in manifest["views"]:
            view["photo"] = os.path.normpath(folder.absolute() / view["photo"]) if view["photo"] else ""
        scene = assemble_scene(manifest, arrays)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise _create_damage_error(folder / manifest_name, error) from error
    if options.keep_every > 1:
        _count_again(scene)
    return scene


def _count_again(scene: Scene) -> None:
    ids, counts = np.unique(scene.instance_ids, return_counts=True)
    found = dict(zip(ids.tolist(), counts.tolist(), strict=True))
    for instance in list(scene.table):
        scene.table.set(replace(instance, count=found.get(instance.id, 0)))


def _holds_scene(path: Path) -> bool:
    return (path / MANIFEST).is_file() if path.is_dir() else path.name == MANIFEST


def _list_files(path: Path) -> tuple[Path, ...]:
    """The files that `read_scene_folder` reads. Raises DataError where the folder holds no scene."""
    folder = path if path.is_dir() else path.parent
    return folder / MANIFEST, folder / _read_manifest(folder / MANIFEST)["arrays"]


def _collect_arrays(scene: Scene) -> dict[str, ndarray]:
    arrays = scene.gaussians.arrays()
    arrays |= {"instance_ids": scene.instance_ids, "codewords": scene.codewords, "nodes": scene.nodes}
    arrays |= {f"{EXTRA}{name}": column for name, column in scene.extra.items()}
    if scene.sky is not None:
        arrays["sky"] = scene.sky.faces
    if scene.actors:
        arrays["track_times"] = np.concatenate([actor.times for actor in scene.actors])
        arrays["track_poses"] = np.concatenate([actor.world_from_box for actor in scene.actors])
    if scene.views:
        arrays["view_poses"] = np.stack([view.camera.world_from_camera for view in scene.views])
    if scene.exposures is not None:
        arrays["exposure_times"], arrays["exposure_matrices"] = scene.exposures.times, scene.exposures.matrices
    return arrays


def _halve_precision(name: str, array: ndarray) -> ndarray:
    if name == "sky":
        return np.round(np.clip(array, 0, 1) * 255).astype(np.uint8)
    if array.dtype == np.float64:
        return array.astype(np.float32)
    return array.astype(np.float16) if array.dtype == np.float32 and name not in _EXACT else array


def _relativize_photo(photo: str, folder: Path) -> str:
    """Make a path relative where folder and photo have a common ancestor, so that both can be moved together."""
    if not photo:
        return ""
    photo, here = os.path.abspath(photo), str(folder.absolute())
    shared = os.path.commonpath([here, photo])
    return photo if shared == os.path.abspath(os.sep) else Path(os.path.relpath(photo, here)).as_posix()


def _read_manifest(path: Path) -> dict[str, Any]:
    try:
        manifest = parse_json(require_plain_file(path).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise _create_damage_error(path, error) from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT_NAME:
        raise DataError(path, f"'format' is not {FORMAT_NAME!r}", "Check that the folder was written by InstDrive")
    if manifest.get("version") != FORMAT_VERSION:
        problem = f"'version' is {manifest.get('version')!r}, this program reads {FORMAT_VERSION}"
        raise DataError(path, problem, "Update InstDrive or save the scene again")
    if not isinstance(manifest.get("arrays"), str) or not _ARRAYS_NAME.fullmatch(manifest["arrays"]):
        problem = f"'arrays' is {manifest.get('arrays')!r}, not the name of an arrays file in the same folder"
        raise DataError(path, problem, "Save the scene again")
    return manifest


def _read_parts(
    folder: Path, manifest_name: str, options: ReadOptions
) -> tuple[dict[str, Any], dict[str, ndarray], str]:
    """Read manifest, arrays and their digest of one save, while another program may be saving."""
    for attempt in range(_ATTEMPTS):
        manifest = _read_manifest(folder / manifest_name)
        path = folder / manifest["arrays"]
        try:
            return manifest, *read_arrays(require_plain_file(path), folder, options)
        except FileNotFoundError as error:
            if attempt == _ATTEMPTS - 1:
                raise _create_damage_error(path, error) from error
        except (SafetensorError, OSError) as error:
            raise _create_damage_error(path, error) from error
    raise AssertionError("the last attempt returns or raises")


def _create_damage_error(path: Path, error: Exception) -> DataError:
    return DataError(
        path, f"the file is damaged ({type(error).__name__}: {error})", "Restore it or save the scene again"
    )


SCENE_FOLDER = Format(
    "InstDrive scene folder",
    "",
    read_scene_folder,
    write_scene_folder,
    Fidelity(is_exact=True),
    folder=FolderLayout(_holds_scene, _list_files, last_file=MANIFEST),
    keeps_tracks=True,
)
