"""OpenGL without a window: a context, facts about its driver, and one picture drawn with it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_app.render.gl.gl_state import GraphicsError
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.document.document import Document

__all__ = ["GraphicsError", "describe_driver", "draw_blended", "open_offscreen_context"]


@contextmanager
def open_offscreen_context() -> Iterator[moderngl.Context]:
    """Open an OpenGL 3.3 context and release it at the end; on Linux through EGL, which needs no display.

    Raises GraphicsError with the driver's words if there is none.
    """
    options: dict[str, Any] = {"backend": "egl"} if sys.platform.startswith("linux") else {}
    try:
        context = moderngl.create_context(standalone=True, require=330, **options)
    except Exception as error:  # the loader of each platform raises its own kinds, plain Exception among them
        raise GraphicsError(
            f"no OpenGL 3.3 context off screen ({error}). Install or update the graphics driver "
            "(Debian without a graphics card: apt install libegl1 libgl1-mesa-dri)"
        ) from error
    try:
        yield context
    finally:
        context.release()


def describe_driver(context: moderngl.Context) -> str:
    """Describe the driver: version, renderer, vendor and largest picture."""
    info = context.info
    side = info["GL_MAX_TEXTURE_SIZE"]
    return f"{info['GL_VERSION']}; {info['GL_RENDERER']}; {info['GL_VENDOR']}; pictures up to {side} px"


def draw_blended(context: moderngl.Context, document: Document, snapshot: FrameSnapshot) -> Float32[ndarray, "h w 4"]:
    """Draw one colour frame, premultiplied over the sky; alpha is coverage. Raises ShaderError or GraphicsError."""
    renderer = GlRenderer(context, document, in_full_floats=True)
    try:
        renderer.render(snapshot)
        blended = renderer.read_blended()
    finally:
        renderer.release()
    fault = context.error
    if fault != "GL_NO_ERROR":
        raise GraphicsError(f"the OpenGL driver reports {fault} after drawing; update the graphics driver")
    if not np.isfinite(blended).all():
        raise GraphicsError("the picture drawn by OpenGL holds values that are not finite; update the graphics driver")
    return blended
