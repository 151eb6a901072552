"""Checkpoints of scenes in which nothing moves: gsplat, nerfstudio's splatfacto and INRIA.

Layouts, as their sources write them:

- gsplat ``examples/simple_trainer.py``: ``{"step", "splats": {means, scales, quats, opacities, sh0, shN}}``;
- nerfstudio ``splatfacto``: ``{"step", "pipeline": {"_model.gauss_params.means", …}}``, before 1.0 without
  ``gauss_params``; ``dataparser_transforms.json`` in the folder above says how the data set was turned and scaled;
- INRIA ``GaussianModel.capture``: ``((degree, xyz, dc, rest, scaling, rotation, opacity, …), iteration)``, 12 entries.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_numbers
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.allocation import ReadOptions
from instdrive_core.formats.checkpoints.splat_part import (
    REMEDY,
    FieldNames,
    read_parts,
    view_part,
)
from instdrive_core.scene.scene import Scene, scene_from_gaussians
from instdrive_core.scene.transforms import Similarity, invert_transform, transform_gaussians

_GSPLAT = FieldNames("means", "quats", "scales", "opacities", "sh0", "shN")
_SPLATFACTO = FieldNames("means", "quats", "scales", "opacities", "features_dc", "features_rest", True)
_TUPLE = FieldNames("xyz", "rotation", "scaling", "opacity", "features_dc", "features_rest")
_INRIA_ENTRIES = 12
_TRANSFORMS, _CONFIG = "dataparser_transforms.json", "config.yml"
_MAX_CONFIG = 1 << 20


def find_gsplat(file: TorchCheckpoint) -> Mapping[Any, Any] | None:
    """The splats of gsplat's trainer; None where it is another checkpoint."""
    return file.find_items((file.find_items(file.content) or {}).get("splats"))


def read_gsplat(file: TorchCheckpoint, splats: Mapping[Any, Any], options: ReadOptions) -> Scene:
    """Read what gsplat's trainer has saved. Raises DataError."""
    if "sh0" not in splats and "features" in splats:
        problem = "its colours come from a network (app_opt), which is not drawn here"
        raise DataError(file.path, problem, "Train without --app_opt, or export a .ply")
    gaussians, _ = read_parts(file.path, [view_part(file, splats, _GSPLAT, "splats")], options)
    left_out = []
    if "pose_adjust" in (file.find_items(file.content) or {}):
        left_out.append("corrections of the cameras, as the checkpoint does not hold the cameras")
    others = sorted(path.name for path in file.path.parent.glob("ckpt_*_rank*.pt") if path.name != file.path.name)
    step = file.path.name.rpartition("_rank")[0]
    if step and any(name.rpartition("_rank")[0] == step for name in others):
        left_out.append(f"the splats of the other GPUs, which are in {', '.join(others[:3])}: convert and join them")
    return replace(scene_from_gaussians(gaussians), left_out=tuple(left_out))


def find_splatfacto(file: TorchCheckpoint) -> Mapping[Any, Any] | None:
    """The tensors of a splatfacto model by their short names; None where it is another checkpoint."""
    pipeline = file.find_items((file.find_items(file.content) or {}).get("pipeline"))
    found = {}
    for name, value in (pipeline or {}).items():
        if isinstance(name, str) and name.removeprefix("module.").startswith("_model."):
            found[name.removeprefix("module.").removeprefix("_model.").removeprefix("gauss_params.")] = value
    return found if "means" in found else None


def read_splatfacto(file: TorchCheckpoint, tensors: Mapping[Any, Any], options: ReadOptions) -> Scene:
    """Read what nerfstudio has saved, in the axes and units of the data set's poses. Raises DataError."""
    gaussians, _ = read_parts(file.path, [view_part(file, tensors, _SPLATFACTO, "_model")], options)
    left_out = []
    folder = next((f for f in (file.path.parent, file.path.parent.parent) if (f / _TRANSFORMS).is_file()), None)
    if folder is None:
        left_out.append(f"the way back to the data set's poses, as no {_TRANSFORMS} lies beside it or one folder above")
    else:
        transform_gaussians(gaussians, invert_transform(_read_dataparser_transform(folder / _TRANSFORMS)))
    if any(name.startswith("camera_optimizer.") for name in tensors):
        left_out.append("corrections of the cameras, as the checkpoint does not hold the cameras")
    if any("bil_grids" in name for name in tensors):
        left_out.append("bilateral grids, which made each photo's colours; the splats' own colours are drawn")
    antialiased = folder is not None and "rasterize_mode: antialiased" in _read_config(folder / _CONFIG)
    return replace(scene_from_gaussians(gaussians), antialiased=antialiased, left_out=tuple(left_out))


def find_captured(file: TorchCheckpoint) -> tuple[Any, ...] | None:
    """What INRIA's ``capture`` gives; None where it is another checkpoint."""
    content = file.content
    if isinstance(content, tuple) and len(content) == 2 and isinstance(content[0], tuple):
        return content[0] if len(content[0]) == _INRIA_ENTRIES else None
    return None


def read_captured(file: TorchCheckpoint, captured: tuple[Any, ...], options: ReadOptions) -> Scene:
    """Read what INRIA's trainer has saved. Raises DataError."""
    names = ("degree", "xyz", "features_dc", "features_rest", "scaling", "rotation", "opacity")
    part = view_part(file, dict(zip(names, captured, strict=False)), _TUPLE, "the scene")
    gaussians, _ = read_parts(file.path, [part], options)
    return scene_from_gaussians(gaussians)


def _read_dataparser_transform(path: Path) -> Similarity:
    """[s R | t] that nerfstudio has turned and scaled the data set with."""
    fields = read_json(path)
    rows = require_field(path, fields, "transform")
    numbers = [require_numbers(path, row, "transform") for row in rows] if isinstance(rows, list) else []
    scale = require_numbers(path, [require_field(path, fields, "scale")], "scale")[0]
    if [len(row) for row in numbers] != [4, 4, 4] or not 1e-9 < scale < 1e9:
        raise DataError(path, "'transform' is no matrix of 3 x 4, or 'scale' no positive number", REMEDY)
    matrix = np.array(numbers)
    rotation = matrix[:, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
        raise DataError(path, "'transform' does more than turn and shift", REMEDY)
    return scale * matrix


def _read_config(path: Path) -> str:
    try:
        with require_plain_file(path).open("rb") as file:
            return file.read(_MAX_CONFIG).decode(errors="replace")
    except OSError:
        return ""
