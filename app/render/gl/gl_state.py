"""GL state that is set in a scope and restored when the scope ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import moderngl

from instdrive_core.errors import InstDriveError

PREMULTIPLIED_OVER = (moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA)


class GraphicsError(InstDriveError):
    """OpenGL 3.3 is missing, or cannot do what is asked."""


@contextmanager
def draw_into(
    ctx: moderngl.Context,
    framebuffer: moderngl.Framebuffer,
    blending: tuple[int, int] | None = None,
    depth_function: str | None = None,
) -> Iterator[None]:
    """Bind a framebuffer with exactly the given blending and depth test.

    Afterwards the previous framebuffer is bound again, and blending and depth test are off and at GL's defaults.
    """
    flags = (moderngl.BLEND if blending else 0) | (moderngl.DEPTH_TEST if depth_function else 0)
    previous = ctx.fbo or ctx.detect_framebuffer()
    framebuffer.use()
    ctx.enable_only(flags)
    if blending:
        ctx.blend_func = blending
    if depth_function:
        ctx.depth_func = depth_function
    try:
        yield
    finally:
        ctx.blend_func = (moderngl.ONE, moderngl.ZERO)
        ctx.depth_func = "<"
        ctx.enable_only(moderngl.NOTHING)
        previous.use()
