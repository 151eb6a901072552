"""Choice of the device that trains: the CPU with our own kernels, or an NVIDIA GPU with gsplat's.

Importing this loads neither torch nor gsplat.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import warnings
from typing import TYPE_CHECKING

import numpy as np

from instdrive_core.errors import OptionError
from instdrive_core.scene.camera import Camera
from instdrive_core.training.settings.config import Device

if TYPE_CHECKING:
    from instdrive_core.training.backends.backend import Backend

_OLDEST_GSPLAT = (1, 5, 3)
"""Earlier ones have other signatures."""
_FIRST_FOR_CUDA_13 = (1, 6)
"""Earlier sources do not compile with CUDA 13's headers."""
_REQUIREMENT = f"'gsplat>={'.'.join(map(str, _OLDEST_GSPLAT))}'"


def choose_backend(device: Device) -> Backend:
    """The backend for `--device`; `auto` takes the GPU where torch sees one and gsplat is installed, else the CPU.

    Raises OptionError for `cuda` where it cannot be had: what is missing, and how to get it.
    """
    missing = None if device == "cpu" else explain_missing_cuda()
    if device != "cpu" and missing is None:
        missing = _failing_kernels()
        if missing is None:
            return _gsplat_backend()
        if device == "auto":
            warnings.warn(f"training on the CPU although there is a GPU: {missing}", stacklevel=2)
    if device == "cuda":
        raise OptionError(f"--device cuda: {missing} Or train with --device cpu.")
    from instdrive_core.training.backends.cpu_backend import CpuBackend

    return CpuBackend()


def explain_missing_cuda() -> str | None:
    """Say what this machine lacks for training on a GPU, and how to get it; None where torch and gsplat are ready."""
    import torch

    if torch.version.cuda is None:
        return (
            f"the installed torch {torch.__version__} was built without CUDA. Install one with it, e.g. `pip install "
            "--force-reinstall torch --index-url https://download.pytorch.org/whl/cu128` (other CUDA versions: "
            "https://pytorch.org/get-started/locally)."
        )
    if not torch.cuda.is_available():
        return (
            f"torch {torch.__version__} finds no usable NVIDIA GPU. Check that `nvidia-smi` lists one, that its driver "
            f"supports CUDA {torch.version.cuda}, and that CUDA_VISIBLE_DEVICES does not hide it."
        )
    if importlib.util.find_spec("gsplat") is None:
        return f"gsplat is not installed. Install it: `pip install {_REQUIREMENT}` (see docs/gpu.md)."
    return _unsuitable_gsplat()


def describe_gpu() -> str:
    """Name and memory of the GPU that trains; only where `explain_missing_cuda` is None."""
    import torch

    properties = torch.cuda.get_device_properties(torch.cuda.current_device())
    return f"{properties.name}, {properties.total_memory / 2**30:.0f} GiB, CUDA {torch.version.cuda}"


def describe_cuda_row() -> str:
    """Name the row of the table in docs/gpu.md, "Which torch with which gsplat", that this machine's torch is in."""
    import torch

    major = _read_version(torch.version.cuda or "")[:1]
    if not major:
        return "torch without CUDA: training on the CPU"
    if major >= (13,):
        return "torch for CUDA 13: gsplat 1.6 or newer"
    return "torch for CUDA 11 or 12: gsplat 1.5.3 or newer"


def _read_version(text: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", text)[:3]))


def measure_free_gpu_memory(backend: Backend) -> int | None:
    """Measure the bytes that nobody uses on the backend's GPU; None where it has none."""
    import torch

    return torch.cuda.mem_get_info(backend.device)[0] if backend.device.type == "cuda" else None


def _unsuitable_gsplat() -> str | None:
    import torch

    try:
        version = str(importlib.import_module("gsplat").__version__)  # quick: kernels are compiled when first used
    except (ImportError, OSError) as error:
        return f"gsplat cannot be imported ({error}). Install it again: `pip install --force-reinstall {_REQUIREMENT}`."
    if _read_version(version) < _OLDEST_GSPLAT:
        return f"gsplat {version} is too old. Install a newer one: `pip install --upgrade {_REQUIREMENT}`."
    if _read_version(torch.version.cuda or "") >= (13,) and _read_version(version) < _FIRST_FOR_CUDA_13:
        return (
            f"gsplat {version} does not compile with CUDA 13, which torch {torch.__version__} was built for (CUDA "
            f"{torch.version.cuda}). Install torch for CUDA 12: `pip install --force-reinstall torch --index-url "
            "https://download.pytorch.org/whl/cu128`, with the CUDA 12.8 toolkit; or gsplat 1.6 or newer: `pip install "
            "git+https://github.com/nerfstudio-project/gsplat` (see docs/gpu.md)."
        )
    return None


def _failing_kernels() -> str | None:
    """Draw one Gaussian: kernels that were not compiled, or not for this GPU, show here and not in the first step."""
    import torch

    try:
        alpha, gradient = _one_gaussian(_gsplat_backend())
    except Exception as error:  # a compiler run in between may raise anything; the user reads it
        problem = f"{type(error).__name__}: {error}"
    else:
        if abs(alpha - 0.5) < 0.01 and np.isfinite(gradient) and gradient > 0:
            return None
        problem = f"one Gaussian of opacity 0.5 came out as {alpha:.3f}, with gradient {gradient:.3g}"
    return (
        f"gsplat's kernels do not work here ({problem}). They are compiled when first used; that needs a C++ compiler "
        f"and the CUDA toolkit that fits torch: `nvcc --version` must show CUDA {torch.version.cuda} (see docs/gpu.md)."
    )


def _gsplat_backend() -> Backend:
    from instdrive_core.training.backends.gsplat_backend import GsplatBackend

    return GsplatBackend()


def _one_gaussian(backend: Backend) -> tuple[float, float]:
    """Alpha in the middle of a Gaussian of opacity 0.5, and its gradient by the opacity's logit."""
    import torch

    camera = Camera(8.0, 8.0, 8.5, 8.5, 17, 17, np.eye(4))
    rows = ([[0.0, 0.0, 4.0]], [[1.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [0.0], [[1.0, 1.0, 1.0]])
    means, quats, log_scales, logits, channels = (torch.tensor(values, device=backend.device) for values in rows)
    _, _, alpha = backend.rasterize(means, quats, log_scales, logits.requires_grad_(True), channels, camera, 3)
    alpha[8, 8].backward()
    assert logits.grad is not None
    return float(alpha[8, 8].detach()), float(logits.grad[0])
