"""The contract of renderers, and the choice between the one on OpenGL and the one on the CPU."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Literal, Protocol, runtime_checkable

import moderngl
from jaxtyping import UInt8, UInt32
from numpy import ndarray

from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import OptionError

CHOICE = "INSTDRIVE_RENDERER"
"""Environment variable that overrides the choice by the driver's name: `gl` or `cpu`."""
SOFTWARE_DRIVERS = ("llvmpipe", "softpipe", "swr", "software", "swiftshader", "gdi generic")
"""Parts of the names of OpenGL drivers that draw on the CPU, where the CPU rasterizer is many times faster."""


@runtime_checkable
class FrameRenderer(Protocol):
    """Draws one document as snapshots ask. All methods run on the thread that owns the GL context."""

    @property
    def frame_seconds(self) -> float:
        """Seconds that the last frame took which had to be blended."""
        ...

    @property
    def picture(self) -> moderngl.Texture | None:
        """The newest frame, RGBA8, row 0 at the top; None before the first."""
        ...

    @property
    def shown(self) -> FrameSnapshot | None:
        """The snapshot that `picture` was drawn for (a `ShownFrame` if its pixels are known); None before the first."""
        ...

    @property
    def settled(self) -> bool:
        """Whether `picture` shows completely what was asked for last."""
        ...

    @property
    def depth_range(self) -> tuple[float, float]:
        """Metres at the near and far end of the depth view's ramp."""
        ...

    def render(self, snapshot: FrameSnapshot, wait: bool = True) -> None:
        """Bring `picture` up to date; without `wait`, only as far as possible at once: repeat until it is `settled`."""
        ...

    def read_rows(self, snapshot: FrameSnapshot) -> UInt32[ndarray, "h w"]:
        """Row + 1 of the splat that the ID view shows at every pixel; 0 = none."""
        ...

    def read_instance_ids(self, snapshot: FrameSnapshot) -> UInt32[ndarray, "h w"]:
        """The instance that the ID view shows at every pixel; 0 = none."""
        ...

    def read_row_at(self, snapshot: FrameSnapshot, x: int, y: int) -> int | None:
        """The splat that the ID view shows at a pixel; None where none is, or outside."""
        ...

    def read_picture(self) -> UInt8[ndarray, "h w 3"]:
        """The newest frame as RGB."""
        ...

    def free_retired(self) -> None:
        """Free pictures of sizes that are no longer drawn. Call it between window frames."""
        ...

    def release(self) -> None:
        """Free everything."""
        ...


def choose_renderer_kind(driver: str, environment: Mapping[str, str] = os.environ) -> Literal["gl", "cpu"]:
    """Choose the renderer that suits a driver, by its name (GL_RENDERER), unless the environment says otherwise.

    Raises OptionError if the environment says neither `gl` nor `cpu`.
    """
    choice = environment.get(CHOICE, "").strip().lower()
    if choice not in ("", "gl", "cpu"):
        raise OptionError(f"{CHOICE} is {choice!r}; set it to gl or cpu, or unset it to choose by the graphics driver")
    if choice:
        return "gl" if choice == "gl" else "cpu"
    return "cpu" if any(name in driver.lower() for name in SOFTWARE_DRIVERS) else "gl"


def is_kind_forced(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether the environment says which renderer is to be used, so that measuring must not change it."""
    return bool(environment.get(CHOICE, "").strip())


def create_renderer(ctx: moderngl.Context, document: Document, wake: Callable[[], None]) -> FrameRenderer:
    """Create a renderer of the document; one that draws on another thread calls `wake` from there for each frame."""
    if choose_renderer_kind(ctx.info["GL_RENDERER"]) == "cpu":
        return create_software_renderer(ctx, document, wake)
    from instdrive_app.render.gl.renderer import GlRenderer

    return GlRenderer(ctx, document, wake)


def create_software_renderer(ctx: moderngl.Context, document: Document, wake: Callable[[], None]) -> FrameRenderer:
    """Create the renderer that draws on the CPU, whatever the driver."""
    from instdrive_app.render.software.renderer import SoftwareRenderer

    return SoftwareRenderer(ctx, document, wake)
