"""Which Gaussians a camera may see, found in plain torch where they lie: the test of `rows_in_view`, for a GPU."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int32, Int64
from numpy import ndarray
from torch import Tensor

from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera
from instdrive_core.training.backends.backend import NodesOnDevice
from instdrive_core.training.backends.torch_ops import to_device
from instdrive_core.training.gaussians.rows_in_view import (
    LENGTH,
    ROUNDING,
    compute_view_limits,
    list_camera_from_nodes,
)


@torch.no_grad()
def find_rows_on_device(
    means: Float[Tensor, "n 3"],
    log_scales: Float[Tensor, "n 3"],
    opacity_logits: Float[Tensor, " n"],
    nodes: Int32[Tensor, " n"],
    background: int,
    poses: Float64[ndarray, "m 4 4"],
    present: Bool[ndarray, " m"],
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> tuple[Int64[Tensor, " v"], NodesOnDevice]:
    """Find the rows, rising, that `find_rows_in_view` finds, within rounding, and their nodes.

    Two numbers are read from the device, together; nothing else is waited for.

    Args:
        nodes: rising.
        background: how many of them are 0.
    """
    frames = np.column_stack([list_camera_from_nodes(poses, camera), present]).astype(np.float32)
    table, limits = to_device(frames, means.device), compute_view_limits(camera, settings).tolist()
    still = slice(None, background), table[0].unbind()
    moving = slice(background, None), table.index_select(0, nodes[background:]).unbind(1)
    seen = torch.cat(
        [
            _test(means[part], log_scales[part], opacity_logits[part], frame, camera, limits)
            for part, frame in (still, moving)
        ]
    )
    in_background, total = torch.stack([seen[:background].sum(), seen.sum()]).tolist()
    # Every row writes its number: those in view to their places, the others to one behind the last.
    places = torch.where(seen, seen.cumsum(0) - 1, total)
    numbers = torch.arange(len(seen), device=means.device)
    rows = torch.empty(total + 1, dtype=torch.int64, device=means.device).scatter_(0, places, numbers)[:total]
    return rows, NodesOnDevice(nodes.index_select(0, rows).long(), in_background)


def _test(
    means: Float[Tensor, "k 3"],
    log_scales: Float[Tensor, "k 3"],
    logits: Float[Tensor, " k"],
    frame: Sequence[Tensor],
    camera: Camera,
    limits: Sequence[float],
) -> Bool[Tensor, " k"]:
    """Whether each row may be seen, as `rows_in_view` tests it. `frame` holds numbers, or one for each row."""
    near, low_pass, least, log_min_alpha, wide_x, wide_y = limits
    mx, my, mz = means.unbind(1)
    fx, fy, cx, cy, width, height = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    slack = ROUNDING * (mx.abs() + my.abs() + mz.abs() + frame[LENGTH])
    x, y, z = (frame[k] * mx + frame[k + 1] * my + frame[k + 2] * mz + frame[k + 3] for k in (0, 4, 8))
    x, y = fx * x, fy * y
    beyond_x = torch.maximum((0.5 - cx) * z - x, (cx - width + 0.5) * z + x) - slack * (fx + abs(cx) + width)
    beyond_y = torch.maximum((0.5 - cy) * z - y, (cy - height + 0.5) * z + y) - slack * (fy + abs(cy) + height)
    variance = log_scales.amax(dim=1).exp().square()
    power = 2 * (logits.clamp_max(0) - log_min_alpha)
    blur = low_pass * z * z
    seen = (z > near - slack) & (logits >= least) & (frame[LENGTH + 1] > 0)
    seen &= beyond_x.clamp_min(0).square() <= power * (variance * wide_x + blur)
    seen &= beyond_y.clamp_min(0).square() <= power * (variance * wide_y + blur)
    return seen
