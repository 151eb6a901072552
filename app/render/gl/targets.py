"""The framebuffers for one viewport size."""

from __future__ import annotations

import moderngl
import numpy as np


class Targets:
    """Where the passes draw: `blended` (colour or depth, may be smaller), `rows`, `mask`, and `shown` for the user."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], blended_size: tuple[int, int]) -> None:
        self.size, self.blended_size = size, blended_size
        self.blended = ctx.texture(blended_size, 4, dtype="f4")
        self.blended.repeat_x = self.blended.repeat_y = False
        self.blended_buffer = ctx.framebuffer([self.blended])
        self.rows = _create_integer_texture(ctx, size, "u4")
        self.depth = ctx.depth_renderbuffer(size)
        self.rows_buffer = ctx.framebuffer([self.rows], self.depth)
        self.mask = _create_integer_texture(ctx, size, "u1")
        self.mask_buffer = ctx.framebuffer([self.mask])
        self.shown = ctx.texture(size, 4, dtype="f1")
        self.shown_buffer = ctx.framebuffer([self.shown])
        self._nothing = np.zeros((size[1], size[0]), np.uint32)

    def clear_rows(self) -> None:
        """Clear `rows` to no splat anywhere. Framebuffer.clear would write float bits into the integer target."""
        self.rows_buffer.clear(depth=1.0)
        self.rows.write(self._nothing, alignment=1)

    def release(self) -> None:
        """Free everything."""
        for thing in (self.blended_buffer, self.rows_buffer, self.mask_buffer, self.shown_buffer):
            thing.release()
        for thing in (self.blended, self.rows, self.depth, self.mask, self.shown):
            thing.release()


def _create_integer_texture(ctx: moderngl.Context, size: tuple[int, int], dtype: str) -> moderngl.Texture:
    texture = ctx.texture(size, 1, alignment=1, dtype=dtype)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
