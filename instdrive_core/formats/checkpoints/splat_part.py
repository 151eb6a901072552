"""Gaussians of one name in a checkpoint, checked and copied into a scene's arrays block by block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.stored_tensor import StoredTensor
from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.allocation import ReadOptions, allocate_gaussians
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import REST_COUNTS, dc_from_color
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians

BLOCK_ROWS = 1 << 16
"""Rows copied at a time; only these are mapped."""
_GROUND_THICKNESS = 1e-3
"""Metres."""
REMEDY = "Check which program has written it; docs/formats.md lists the checkpoints that are read"


@dataclass(frozen=True)
class FieldNames:
    """What a trainer calls the arrays of its Gaussians."""

    means: str
    quats: str
    log_scales: str
    opacity_logits: str
    sh_dc: str
    sh_rest: str
    sigmoid_without_sh: bool = False
    """Whether the colour of splats without SH is the sigmoid of `sh_dc`."""
    flat_in_y: bool = False
    """Whether sizes are those along x and z of splats that are 1 mm thick, as of HUGSIM's ground."""


@dataclass(frozen=True)
class SplatPart:
    """Gaussians of one name: n rows, raw as INRIA's."""

    name: str
    means: StoredTensor
    quats: StoredTensor
    log_scales: StoredTensor
    """(n, 3), (n, 1) where splats are balls, or (n, 2) along x and z of splats that are 1 mm thick."""
    opacity_logits: StoredTensor
    sh_dc: StoredTensor
    """(n, 3), or (n, f, 3) with f coefficients over time."""
    sh_rest: StoredTensor | None
    is_sigmoid: bool
    """Whether `sh_dc` holds logits of colours."""

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def rest(self) -> int:
        """SH coefficients above the constant."""
        return 0 if self.sh_rest is None else self.sh_rest.shape[1]


def require_tensor(file: TorchCheckpoint, fields: Mapping[Any, Any], name: str, where: str) -> StoredTensor:
    """The tensor of a name. Raises DataError where there is none."""
    tensor = file.find_tensor(fields.get(name))
    if tensor is None:
        raise DataError(file.path, f"the tensor {f'{where}.{name}'.strip('.')!r} is missing", REMEDY)
    return tensor


def view_part(file: TorchCheckpoint, fields: Mapping[Any, Any], names: FieldNames, where: str) -> SplatPart:
    """View the Gaussians of one name. Raises DataError where a tensor is missing or has another shape."""
    means, quats, log_scales, opacity_logits, sh_dc = (
        require_tensor(file, fields, name, where)
        for name in (names.means, names.quats, names.log_scales, names.opacity_logits, names.sh_dc)
    )
    sh_rest = file.find_tensor(fields.get(names.sh_rest))
    count = means.shape[0] if means.shape else 0
    if log_scales.shape == (count, 2) and not names.flat_in_y:
        problem = f"{where or 'the scene'} holds splats of two sizes: it was trained with 2D Gaussians, flat discs"
        raise DataError(file.path, problem, "Train 3D Gaussians")
    rest = 0 if sh_rest is None or len(sh_rest.shape) != 3 else sh_rest.shape[1]
    allowed = {
        names.means: (means, [(count, 3)]),
        names.quats: (quats, [(count, 4)]),
        names.log_scales: (log_scales, [(count, 2)] if names.flat_in_y else [(count, 3), (count, 1)]),
        names.opacity_logits: (opacity_logits, [(count, 1), (count,)]),
        names.sh_dc: (sh_dc, [(count, 3), (count, max(*sh_dc.shape[1:2], 1), 3)]),
    }
    if sh_rest is not None:
        allowed[names.sh_rest] = sh_rest, [(count, number, 3) for number in REST_COUNTS]
    for name, (tensor, shapes) in allowed.items():
        is_float = tensor.storage.dtype.kind == "f" or tensor.storage.is_bfloat
        if tensor.shape not in shapes or not is_float:
            expected = " or ".join(map(str, shapes[:4]))
            problem = f"{f'{where}.{name}'.strip('.')!r} is {tensor.storage.dtype} of shape {tensor.shape}"
            raise DataError(file.path, f"{problem}, not floats of {expected}", REMEDY)
    is_sigmoid = names.sigmoid_without_sh and rest == 0
    return SplatPart(where, means, quats, log_scales, opacity_logits, sh_dc, sh_rest if rest else None, is_sigmoid)


def read_parts(path: Path, parts: Sequence[SplatPart], options: ReadOptions) -> tuple[Gaussians, list[slice]]:
    """Read parts one after the other.

    Returns: the Gaussians with the largest part's SH degree (zeros in the others), and the kept rows of each part.
    Raises DataError, SceneTooLargeError.
    """
    count, rest = sum(map(len, parts)), max((part.rest for part in parts), default=0)
    if not count:
        raise DataError(path, "the checkpoint holds no splats", REMEDY)
    gaussians = allocate_gaussians(path, count, rest, 0, options)
    start, rows = 0, []
    for part in parts:
        for first in range(0, len(part), BLOCK_ROWS):
            stop = min(first + BLOCK_ROWS, len(part))
            source, target = options.locate_rows(start + first, start + stop)
            _copy_rows(part, first, stop, source, gaussians, target)
            report((start + stop) / count)
        rows.append(slice(options.count_kept(start), options.count_kept(start + len(part))))
        start += len(part)
    return gaussians, rows


def _copy_rows(part: SplatPart, first: int, stop: int, source: slice, gaussians: Gaussians, target: slice) -> None:
    def take(tensor: StoredTensor) -> ndarray:
        return tensor.read(first, stop)[source]

    with np.errstate(over="ignore"):  # too large for float32 is infinite, which the linter reports
        gaussians.means[target] = take(part.means)
        gaussians.quats[target] = take(part.quats)
        log_scales = take(part.log_scales)
        if log_scales.shape[1] == 2:
            log_scales = np.insert(log_scales, 1, np.log(_GROUND_THICKNESS), axis=1)
        gaussians.log_scales[target] = log_scales
        logits = take(part.opacity_logits)
        gaussians.opacity_logits[target] = logits.reshape(len(logits))
        sh_dc = take(part.sh_dc)
        sh_dc = sh_dc if sh_dc.ndim == 2 else sh_dc[:, 0]
        gaussians.sh_dc[target] = dc_from_color(sigmoid(sh_dc)) if part.is_sigmoid else sh_dc
        if part.sh_rest is not None:
            gaussians.sh_rest[target, : part.rest] = take(part.sh_rest)
        gaussians.sh_rest[target, part.rest :] = 0
