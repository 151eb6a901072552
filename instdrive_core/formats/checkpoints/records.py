"""Checkpoints of torch as records, one for each ending; what a file holds decides how it is read."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import TorchCheckpoint, open_torch_checkpoint
from instdrive_core.formats.allocation import WHOLE, ReadOptions
from instdrive_core.formats.checkpoints.drivestudio import find_models, read_drivestudio_checkpoint
from instdrive_core.formats.checkpoints.hugsim import HUGSIM_META, find_hugsim, list_moving_objects, read_hugsim
from instdrive_core.formats.checkpoints.splat_part import REMEDY
from instdrive_core.formats.checkpoints.static_scenes import (
    find_captured,
    find_gsplat,
    find_splatfacto,
    read_captured,
    read_gsplat,
    read_splatfacto,
)
from instdrive_core.formats.checkpoints.street_gaussians import find_street, read_street
from instdrive_core.formats.scene_format import FolderLayout, Format
from instdrive_core.scene.scene import Scene

_HUGSIM_SCENE = "scene.pth"


def read_checkpoint_scene(path: Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a checkpoint of drivestudio, StreetGaussians, gsplat, splatfacto, INRIA or HUGSIM.

    Raises UntrustedDataError where it asks for what no scene needs, DataError where anything else is wrong.
    """
    file = open_torch_checkpoint(Path(path))
    if (models := find_models(file)) is not None:
        return read_drivestudio_checkpoint(file, models, options)
    if (models := find_street(file)) is not None:
        return read_street(file, models, options)
    if (splats := find_gsplat(file)) is not None:
        return read_gsplat(file, splats, options)
    if (tensors := find_splatfacto(file)) is not None:
        return read_splatfacto(file, tensors, options)
    if (captured := find_captured(file)) is not None:
        return read_captured(file, captured, options)
    if (parameters := find_hugsim(file)) is not None:
        return read_hugsim(file, parameters, options)
    raise DataError(file.path, f"it holds no scene that is known: {_describe(file)}", REMEDY)


def read_hugsim_folder(path: Path, options: ReadOptions = WHOLE) -> Scene:
    """Open the scene of a folder that HUGSIM has exported, or the file in it. Raises DataError."""
    return read_checkpoint_scene(path / _HUGSIM_SCENE if path.is_dir() else path, options)


def _holds_hugsim(path: Path) -> bool:
    return path.is_dir() and (path / _HUGSIM_SCENE).is_file()


def _list_hugsim_files(path: Path) -> tuple[Path, ...]:
    """The scene, its objects, and what tells where they were."""
    objects = list_moving_objects(path)
    motions = (path / f"unicycle_{name}.pth" for name in objects)
    beside = [*motions, path / HUGSIM_META] if objects else []
    return (path / _HUGSIM_SCENE, *objects.values(), *(file for file in beside if file.is_file()))


def _describe(file: TorchCheckpoint) -> str:
    items = file.find_items(file.content)
    if items is None:
        return f"a {type(file.content).__name__}"
    names = ", ".join(repr(key[:40]) for key in list(items)[:8] if isinstance(key, str))
    return f"a dictionary of {len(items)} ({names})"


CHECKPOINT_PTH = Format(
    "Checkpoint of drivestudio, StreetGaussians, INRIA, HUGSIM", ".pth", read_checkpoint_scene, in_world_of_photos=True
)
CHECKPOINT_PT = Format("Checkpoint of gsplat", ".pt", read_checkpoint_scene, in_world_of_photos=True)
CHECKPOINT_CKPT = Format(
    "Checkpoint of nerfstudio's splatfacto", ".ckpt", read_checkpoint_scene, in_world_of_photos=True
)
HUGSIM_FOLDER = Format(
    "Exported scene of HUGSIM",
    _HUGSIM_SCENE,
    read_hugsim_folder,
    folder=FolderLayout(_holds_hugsim, _list_hugsim_files),
    in_world_of_photos=True,
)
