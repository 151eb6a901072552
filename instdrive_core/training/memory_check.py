"""Check, before any photo is read, that a clip can be trained in the memory that there is."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import psutil

from instdrive_core.available_memory import measure_available_memory
from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.errors import OptionError, format_gigabytes
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.views.photo_budget import BYTES_PER_PIXEL, LEAST_BUDGET

PROGRAM_BYTES = 0.5e9
"""Memory of a training process with few Gaussians and small photos; measured: 0.44 GB."""
STEP_BYTES = 242
"""Bytes per pixel of the photo in a step; measured from 480×270 to 3840×2160."""

_PLACE_VALUES = 3 + 4 + 3 + 1
"""Mean, quaternion, scales and opacity."""
_COUNTS = 1 + 2
"""Adam's count of updates; sum and count of the screen-space gradients."""
_SHARE_OF_STATE = 0.5
"""Share of the free memory that is suggested for the state: refining holds the old one beside the new one."""
GAUSSIAN_BYTES = 2e3
"""Bytes of a Gaussian with its gradients and what the optimiser remembers."""
PHOTO_BYTES = 3e6
"""Bytes of a training photo with its masks, depths and votes: 480 photos of a drive of 80 steps took 4.0 GB with
900,000 Gaussians."""


def estimate_training_bytes(sizes: list[tuple[int, int]]) -> float:
    """Estimate the bytes that photos of these widths and heights need at least.

    Gaussians come on top, see `GAUSSIAN_BYTES`.
    """
    pixels = [width * height for width, height in sizes]
    return PROGRAM_BYTES + STEP_BYTES * max(pixels, default=0) + min(LEAST_BUDGET, BYTES_PER_PIXEL * sum(pixels))


def count_affordable_photos(clip: Clip, gaussians: int) -> int:
    """Count the training photos of a clip's size that the free memory suffices for, at least one.

    `gaussians` is the largest number that may grow.
    """
    frame = max(clip.training_frames, key=lambda frame: math.prod(_sizes((frame,))[0]))
    fixed = estimate_training_bytes(_sizes((frame,))) + GAUSSIAN_BYTES * gaussians
    return max(1, int((measure_available_memory() - fixed) / PHOTO_BYTES))


def check_training_memory(clip: Clip) -> None:
    """Check that memory suffices for the clip's photos.

    Raises OptionError where it does not, with a scale or cameras that would do.
    """
    frames = clip.training_frames
    needed, available = estimate_training_bytes(_sizes(frames)), measure_available_memory()
    if needed <= available:
        return
    width, height = max(_sizes(frames), key=math.prod)
    problem = f"{len(frames)} photos of up to {width}×{height} need at least {format_gigabytes(needed)} to be trained"
    ways = [way for way in (_suggest_scale(frames, available), _suggest_cameras(clip, available)) if way]
    remedy = " or ".join(ways) or "use a machine with more memory"
    raise OptionError(f"{clip.path}: {problem}, {format_gigabytes(available)} are free; {remedy}")


def count_state_bytes(config: TrainConfig) -> int:
    """Count the bytes that a Gaussian takes between two steps: its values, Adam's two moments of each, and counts."""
    harmonics = (config.geometry.sh_degree + 1) ** 2
    features = config.trained_feature_dim
    values = _PLACE_VALUES + 3 * harmonics + features
    return 4 * (3 * values + _COUNTS + (1 if features else 0))  # features have a count of updates of their own


def check_gpu_memory(config: TrainConfig, free: int) -> None:
    """Check that a GPU holds the state of all Gaussians that may grow, with `free` bytes that nothing else uses.

    This is the least by calculation: what a step draws with comes on top. Raises OptionError with a number that fits.
    """
    count, each = config.densify.max_gaussians, count_state_bytes(config)
    if config.freeze_geometry or count * each <= free:
        return
    raise OptionError(
        f"--device cuda: {count:,} Gaussians take at least {format_gigabytes(count * each)} of the GPU's memory, "
        f"{format_gigabytes(free)} are free; give --max-gaussians {int(free * _SHARE_OF_STATE / each)}, close other "
        "programs that use the GPU, or train with --device cpu"
    )


def _sizes(frames: tuple[Frame, ...], factor: float = 1.0) -> list[tuple[int, int]]:
    cameras = [frame.view.camera for frame in frames]
    return [(round(camera.width * factor), round(camera.height * factor)) for camera in cameras]


def _suggest_scale(frames: tuple[Frame, ...], available: float) -> str:
    """Suggest the largest scale, in hundredths of the photos on disk, that fits."""
    now = frames[0].view.camera.width / read_photo_size(Path(frames[0].view.photo))[0]
    for hundredths in range(math.floor(100 * now), 0, -1):
        if estimate_training_bytes(_sizes(frames, hundredths / 100 / now)) <= available:
            return f"--scale {hundredths / 100:g} would fit"
    return ""


def _suggest_cameras(clip: Clip, available: float) -> str:
    """Suggest the first cameras that fit, as many as do."""
    for count in range(len(clip.camera_names) - 1, 0, -1):
        names = clip.camera_names[:count]
        chosen = tuple(frame for frame in clip.training_frames if frame.view.name in names)
        if estimate_training_bytes(_sizes(chosen)) <= available:
            return f"--cameras {','.join(names)} would fit"
    return ""


def measure_peak_memory() -> int:
    """Measure the most memory that this process has held so far, in bytes."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # macOS counts bytes, Linux KiB
