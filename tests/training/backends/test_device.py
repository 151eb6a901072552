"""Which backend a run gets, and what the user reads where the GPU cannot be had."""

from __future__ import annotations

import importlib.machinery
import subprocess
import sys
import types
from pathlib import Path

import pytest
import torch
from torch_splatting import TorchSplatting, backend_of

from instdrive_core.errors import OptionError
from instdrive_core.training.backends import device
from instdrive_core.training.backends.device import choose_backend, describe_cuda_row, explain_missing_cuda


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A machine that has everything: torch with CUDA, a GPU, gsplat; its kernels are the stand-in's."""
    gsplat = types.ModuleType("gsplat")
    gsplat.__spec__ = importlib.machinery.ModuleSpec("gsplat", None)
    gsplat.__version__ = "1.5.3"  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "gsplat", gsplat)
    monkeypatch.setattr(torch.version, "cuda", "12.8")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(device, "_gsplat_backend", lambda: backend_of("like 1.5"))
    return monkeypatch


def without_cuda_in_torch(machine: pytest.MonkeyPatch) -> None:
    machine.setattr(torch.version, "cuda", None)


def without_gpu(machine: pytest.MonkeyPatch) -> None:
    machine.setattr(torch.cuda, "is_available", lambda: False)


def without_gsplat(machine: pytest.MonkeyPatch) -> None:
    machine.delitem(sys.modules, "gsplat")
    find_spec = importlib.util.find_spec
    machine.setattr(importlib.util, "find_spec", lambda name: None if name == "gsplat" else find_spec(name))


def with_old_gsplat(machine: pytest.MonkeyPatch) -> None:
    machine.setattr(sys.modules["gsplat"], "__version__", "1.4.0+pt24cu124")


def with_gsplat_that_cannot_be_imported(machine: pytest.MonkeyPatch) -> None:
    def fails(name: str) -> types.ModuleType:
        raise ImportError("libcudart.so.12: cannot open shared object file")

    machine.setattr(importlib, "import_module", fails)


def with_gsplat_that_does_not_compile(machine: pytest.MonkeyPatch) -> None:
    machine.setattr(torch.version, "cuda", "13.0")


LACKS = [
    (without_cuda_in_torch, r"torch \S+ was built without CUDA.*pip install --force-reinstall torch --index-url"),
    (without_gpu, r"finds no usable NVIDIA GPU.*nvidia-smi.*CUDA 12\.8.*CUDA_VISIBLE_DEVICES"),
    (without_gsplat, r"gsplat is not installed.*pip install 'gsplat>=1\.5\.3'"),
    (with_old_gsplat, r"gsplat 1\.4\.0\+pt24cu124 is too old.*pip install --upgrade 'gsplat>=1\.5\.3'"),
    (
        with_gsplat_that_does_not_compile,
        r"gsplat 1\.5\.3 does not compile with CUDA 13.*\(CUDA 13\.0\).*whl/cu128.*1\.6",
    ),
    (with_gsplat_that_cannot_be_imported, r"cannot be imported \(libcudart.*pip install --force-reinstall 'gsplat"),
]


def test_a_machine_with_everything_trains_on_the_gpu(machine: pytest.MonkeyPatch) -> None:
    assert explain_missing_cuda() is None
    assert choose_backend("auto").name == "gsplat"
    assert choose_backend("cuda").name == "gsplat"
    assert choose_backend("cpu").name == "cpu"


@pytest.mark.parametrize("version", ["1.5.3", "1.5.3+pt27cu128", "1.6.0", "2.0"])
def test_newer_versions_are_taken(machine: pytest.MonkeyPatch, version: str) -> None:
    machine.setattr(sys.modules["gsplat"], "__version__", version)
    assert explain_missing_cuda() is None


@pytest.mark.parametrize(
    ("cuda", "gsplat", "is_taken"),
    [("12.8", "1.5.3", True), ("12.8", "1.6.0", True), ("13.0", "1.5.3+pt29cu130", False), ("13.2", "1.6.0", True)],
)
def test_gsplat_is_held_against_the_cuda_of_torch(
    machine: pytest.MonkeyPatch, cuda: str, gsplat: str, is_taken: bool
) -> None:
    machine.setattr(torch.version, "cuda", cuda)
    machine.setattr(sys.modules["gsplat"], "__version__", gsplat)
    assert (explain_missing_cuda() is None) == is_taken


@pytest.mark.parametrize("cuda", [None, "11.8", "12.4", "12.8", "13.0", "14.1"])
def test_the_row_that_doctor_names_is_in_the_table(machine: pytest.MonkeyPatch, cuda: str | None) -> None:
    machine.setattr(torch.version, "cuda", cuda)
    torch_of_row, gsplat_of_row = describe_cuda_row().split(": ")
    page = (Path(__file__).parents[3] / "docs" / "gpu.md").read_text(encoding="utf-8")
    assert any(line.startswith(f"| {torch_of_row} |") and gsplat_of_row in line for line in page.splitlines())


@pytest.mark.parametrize(("lack", "message"), LACKS, ids=[lack.__name__ for lack, _ in LACKS])
def test_what_is_missing_is_named_with_its_remedy(machine: pytest.MonkeyPatch, lack, message: str) -> None:
    lack(machine)
    with pytest.raises(OptionError, match=rf"^--device cuda: .*{message}.*--device cpu\.$"):
        choose_backend("cuda")
    assert choose_backend("auto").name == "cpu"
    assert choose_backend("cpu").name == "cpu"


class BrokenSplatting(TorchSplatting):
    """gsplat without its compiled part."""

    def fully_fused_projection(self, *args, **options):
        raise AttributeError("'NoneType' object has no attribute 'projection_ewa_3dgs_fused_fwd'")


class BlindSplatting(TorchSplatting):
    """Kernels that run and draw nothing, as those compiled for another GPU may."""

    def rasterize_to_pixels(self, *args, **options):
        image, alpha = super().rasterize_to_pixels(*args, **options)
        return 0 * image, 0 * alpha


@pytest.mark.parametrize(
    ("library", "problem"), [(BrokenSplatting, "AttributeError: 'NoneType'"), (BlindSplatting, "came out as 0.000")]
)
def test_kernels_that_do_not_work_are_found_at_once(machine: pytest.MonkeyPatch, library, problem: str) -> None:
    from instdrive_core.training.backends.gsplat_backend import GsplatBackend

    machine.setattr(device, "_gsplat_backend", lambda: GsplatBackend(torch.device("cpu"), library()))
    with pytest.raises(OptionError, match=rf"do not work here \(.*{problem}.*nvcc --version` must show CUDA 12\.8"):
        choose_backend("cuda")
    with pytest.warns(UserWarning, match=rf"on the CPU although there is a GPU: .*{problem}"):
        backend = choose_backend("auto")
    assert backend.name == "cpu"


def test_the_cpu_is_never_asked_about_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "explain_missing_cuda", lambda: pytest.fail("asked"))
    assert choose_backend("cpu").device.type == "cpu"


def test_importing_loads_neither_torch_nor_gsplat() -> None:
    code = "import instdrive_core.training.backends.device, sys; assert not {'torch', 'gsplat'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
