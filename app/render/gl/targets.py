"""The framebuffers for one viewport size."""

from __future__ import annotations

import moderngl
import numpy as np
from jaxtyping import UInt32
from numpy import ndarray


class Targets:
    """Where the passes draw: `blended` (colour or depth, may be smaller), `rows`, `mask`, and `shown` for the user."""

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], blended_size: tuple[int, int], in_full_floats: bool
    ) -> None:
        """`blended` holds floats of 16 bits, or of 32."""
        self.size, self.blended_size, self.in_full_floats = size, blended_size, in_full_floats
        self.blended = ctx.texture(blended_size, 4, dtype="f4" if in_full_floats else "f2")
        self.blended.repeat_x = self.blended.repeat_y = False
        self.blended_buffer = ctx.framebuffer([self.blended])
        self.rows = _create_integer_texture(ctx, size, "u4")
        self.depth = ctx.depth_renderbuffer(size)
        self.rows_buffer = ctx.framebuffer([self.rows], self.depth)
        self.mask = _create_integer_texture(ctx, size, "u1")
        self.mask_buffer = ctx.framebuffer([self.mask])
        self.shown = ctx.texture(size, 4, dtype="f1")
        self.shown_buffer = ctx.framebuffer([self.shown])

    def write_rows(self, rows: UInt32[ndarray, "h w"]) -> None:
        """Write row + 1 of every pixel's splat, 0 for none, as somebody else has found them."""
        self.rows.write(np.ascontiguousarray(rows), alignment=1)

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
