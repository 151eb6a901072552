"""`instdrive doctor`: what this machine offers, and whether pictures come out right."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

import instdrive_app
from instdrive_app.shell.display import check_display, find_display_name
from instdrive_app.state import EditorState, FrameSnapshot, Intrinsics, Viewpoint, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import InstDriveError
from instdrive_core.extras import explain_missing_module
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians
from instdrive_core.scene.sky import Sky

PACKAGES = (
    *("numpy", "numba", "scipy", "pillow", "torch", "gsplat", "moderngl", "imgui-bundle", "glfw"),
    *("trimesh", "zstandard", "transformers"),
)
OPTIONAL = {
    "gsplat": "only for training on a GPU",
    "torch": "only for training and masks",
    "transformers": "only for masks by Segment Anything",
}
PICTURE = (160, 120)
"""Pixels of the tested render."""
LARGEST_MEAN_DIFFERENCE = 2e-4
"""Largest mean difference of two rasterizers that agree, in [0, 1]; a missing splat makes a larger one."""


class DoctorError(InstDriveError):
    """Something that the program needs does not work on this machine."""


def doctor() -> None:
    """Print versions and the state of OpenGL and CUDA, and test a render.

    The exit status is 2 where the CPU rasterizer, OpenGL or a display that is named does not work; a GPU for training
    may be missing.
    """
    _print_line("instdrive", f"{version('instdrive')} at {os.path.dirname(instdrive_app.__file__)}")
    _print_line("Python", f"{platform.python_version()} ({sys.executable})")
    _print_line("system", f"{platform.platform()}, {os.cpu_count()} processors")
    _print_line("packages", ", ".join(_describe_package(name) for name in PACKAGES))
    checks = {"display": _check_display, "CPU render": _check_cpu_render, "OpenGL": _check_opengl_render}
    failures = [_run_check(label, check) for label, check in checks.items()]
    _print_line("CUDA", _describe_cuda())
    failed = [failure for failure in failures if failure]
    if failed:
        raise DoctorError("; ".join(failed))
    print("All that the editor needs works." if find_display_name() else "All works; the editor needs a display, too.")


def _print_line(label: str, text: str) -> None:
    # Flushed: should a driver crash the process, the last line says what it was doing.
    print(f"{label + ':':<12}{text}", flush=True)


def _describe_package(name: str) -> str:
    try:
        return f"{name} {version(name)}"
    except PackageNotFoundError:
        return f"{name} missing ({OPTIONAL.get(name, 'needed')})"


def _run_check(label: str, check: Callable[[], str]) -> str | None:
    """Run a check and print its result; returns what failed, else None."""
    try:
        _print_line(label, check())
    except Exception as error:  # whatever it is, the user came to read it, and the other checks follow
        known = isinstance(error, InstDriveError)
        _print_line(label, f"FAILED: {error if known else f'{type(error).__name__}: {error}'}")
        return f"{label} does not work"
    return None


def _check_display() -> str:
    name = find_display_name()
    if not name:
        return "none named; on a machine without a desktop use xvfb-run instdrive edit SCENE"
    check_display()
    return name


def _check_cpu_render() -> str:
    """Render one splat in the middle of the picture, whose colour follows from its opacity."""
    from numba.np.ufunc.parallel import get_num_threads, threading_layer

    snapshot = _create_snapshot()
    one = _create_splats(np.zeros((1, 3)), 0.2, opacity_logit=0.0, color=(1.0, 0.5, 0.0))
    shown = _render_on_cpu(scene_from_gaussians(one), snapshot)
    middle = shown[PICTURE[1] // 2, PICTURE[0] // 2]
    expected = np.array([0.5, 0.25, 0.0, 0.5])
    if not np.allclose(middle, expected, atol=0.01):
        raise DoctorError(f"a splat of opacity 0.5 came out as {np.round(middle, 3)} instead of {expected}")
    return f"works ({get_num_threads()} threads, layer {threading_layer()})"


def _check_opengl_render() -> str:
    """Render a scene by OpenGL and by the CPU, which share no code, and compare."""
    # Imported here: a missing driver library must be a line of the report.
    from instdrive_app.render.frame_renderer import CHOICE, choose_renderer_kind
    from instdrive_app.render.offscreen import describe_driver, draw_blended, open_offscreen_context

    scene, snapshot = _create_test_scene(), _create_snapshot()
    with open_offscreen_context() as context:
        facts = describe_driver(context)
        drawer = "the CPU" if choose_renderer_kind(context.info["GL_RENDERER"]) == "cpu" else "OpenGL"
        shown = draw_blended(context, Document(scene), snapshot)
    difference = float(np.abs(shown - _render_on_cpu(scene, snapshot)).mean())
    if not difference < LARGEST_MEAN_DIFFERENCE:
        raise DoctorError(f"{facts}: the picture differs from the CPU's by {difference:.2g} on average")
    choice = f"in the editor {drawer} draws the splats ({CHOICE}=gl or cpu overrules that)"
    return f"{facts}; a test render equals the CPU's to {difference:.1g}; {choice}"


def _describe_cuda() -> str:
    try:
        from instdrive_core.training.backends.device import (
            choose_backend,
            describe_cuda_row,
            describe_gpu,
            explain_missing_cuda,
        )

        missing = explain_missing_cuda()
        if missing is not None:
            return f"training uses the CPU: {missing} Row in docs/gpu.md: {describe_cuda_row()}"
        choose_backend("cuda")  # draws one Gaussian
        return f"{describe_gpu()}; gsplat draws (row in docs/gpu.md: {describe_cuda_row()})"
    except ModuleNotFoundError as error:
        return f"not looked for: {explain_missing_module(error) or error}"
    except (ImportError, OSError) as error:
        return f"torch cannot be loaded ({error}). Install it again; training needs it, the editor does not"
    except InstDriveError as error:
        return str(error)


def _render_on_cpu(scene: Scene, snapshot: FrameSnapshot) -> Float32[ndarray, "h w 4"]:
    from instdrive_core.rasterize.scene_view import view_scene

    shown = view_scene(scene, snapshot.camera, snapshot.time)
    return np.concatenate([shown.color, shown.alpha[..., None]], axis=2).astype(np.float32)


def _create_snapshot() -> FrameSnapshot:
    pose = look_at(np.array([0.0, -4.0, 0.0]), np.zeros(3))
    viewpoint = Viewpoint(pose, Intrinsics.from_field_of_view(50.0))
    return resolve(EditorState(viewpoint=viewpoint), *PICTURE)


def _create_test_scene() -> Scene:
    """Create splats of many sizes and colours before a sky of two halves."""
    rng = np.random.default_rng(5)
    count = 24
    gaussians = _create_splats(rng.uniform(-1, 1, (count, 3)), 0.15, 1.0, (0.5, 0.5, 0.5))
    gaussians.quats[:] = rng.normal(size=(count, 4))
    gaussians.log_scales[:] += rng.normal(0, 0.5, (count, 3))
    gaussians.sh_dc[:] = rng.normal(0, 1, (count, 3))
    scene = scene_from_gaussians(gaussians)
    faces = np.full((6, 8, 8, 3), 0.3, np.float32)
    faces[:, :4] = (0.4, 0.6, 0.9)
    scene.sky = Sky(faces)
    return scene


def _create_splats(places: ndarray, size: float, opacity_logit: float, color: tuple[float, float, float]) -> Gaussians:
    count = len(places)
    return Gaussians(
        means=places.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), np.log(size), np.float32),
        opacity_logits=np.full(count, opacity_logit, np.float32),
        sh_dc=np.tile(dc_from_color(np.array(color, np.float32)), (count, 1)),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
