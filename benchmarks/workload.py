"""The shared synthetic street that all speed figures are measured on (W1, W2, W3; states init and trained)."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.errors import DataError, OptionError
from instdrive_core.scene.camera import Camera

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT.parent / "shared" / "bench" / "street_workload.py"
CACHE = ROOT / "runs" / "workloads"

SIZES = {"W1": (20_000, 480, 270), "W2": (100_000, 480, 270), "W3": (100_000, 960, 540)}
"""Gaussians, width, height."""
STATES = ("init", "trained")


@dataclass(frozen=True)
class Workload:
    """Gaussians and cameras in the layout that `instdrive_core.rasterize` takes."""

    means: Float32[ndarray, "n 3"]
    quats: Float32[ndarray, "n 4"]
    log_scales: Float32[ndarray, "n 3"]
    opacities: Float32[ndarray, " n"]
    channels: Float32[ndarray, "n 11"]
    """RGB and 8 features."""
    cameras: tuple[Camera, ...]


def load_workload(name: str, state: str) -> Workload:
    """One workload, generated on first use.

    Raises:
        OptionError: unknown name or state.
        DataError: the generating script is not beside the repository, or failed.
    """
    if name not in SIZES or state not in STATES:
        raise OptionError(
            f"no workload {name!r} in state {state!r}; choose from {', '.join(SIZES)} × {', '.join(STATES)}"
        )
    return generate_workload(*SIZES[name], state)


def generate_workload(count: int, width: int, height: int, state: str) -> Workload:
    """A street of any size, kept for the next time. Raises DataError as `load_workload` does."""
    folder = CACHE / f"{count}-{width}x{height}"
    if not (folder / f"{state}.npz").is_file():
        _generate(folder, count, width, height)
    with np.load(folder / f"{state}.npz") as stored:
        arrays = {key: stored[key] for key in stored.files}
    return Workload(
        means=arrays["means"],
        quats=arrays["quats"],
        log_scales=np.log(arrays["scales"]),
        opacities=arrays["opac"],
        channels=np.ascontiguousarray(np.concatenate([arrays["rgb"], arrays["feat"]], axis=1)),
        cameras=_cameras(arrays["K"], arrays["W2C"], arrays["WH"]),
    )


def _generate(folder: Path, count: int, width: int, height: int) -> None:
    if not SCRIPT.is_file():
        raise DataError(SCRIPT, "the workload script is missing", "Measure where shared/ lies beside the repository.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(SCRIPT), str(folder), str(count), str(width), str(height)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        problem = f"generating {folder.name} failed: {result.stderr.strip()[-500:]}"
        raise DataError(SCRIPT, problem, "Fix the script, then run again.")


def _cameras(intrinsics: ndarray, camera_from_world: ndarray, size: ndarray) -> tuple[Camera, ...]:
    fx, fy, cx, cy = (float(value) for value in intrinsics)
    width, height = (int(value) for value in size)
    poses = np.linalg.inv(camera_from_world.astype(np.float64))
    return tuple(Camera(fx, fy, cx, cy, width, height, pose) for pose in poses)
