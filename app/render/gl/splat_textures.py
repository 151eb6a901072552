"""Per-splat arrays as 2-D textures that grow: texel i lies at (i mod width, i // width)."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import numpy as np
from numpy import ndarray

from instdrive_app.render.gl.gl_state import GraphicsError

WIDTH = 8192
"""Texels per row: a power of two that every graphics card with OpenGL 3.3 supports. The usual limit of 16,384 rows
holds 11 million splats of SH degree 3."""
SPARE_SHARE = 8
"""A texture that grows gets one spare row per this many."""


class ArrayTexture:
    """A texture of entries of `texels` texels each, fetched unfiltered.

    Growing copies the content on the GPU into a larger texture with room to spare, so adding a car to a large scene
    uploads only the car. It never shrinks. Growing replaces `texture`, so look it up whenever you bind it.
    """

    def __init__(self, ctx: moderngl.Context, channels: int, dtype: str, texels: int = 1) -> None:
        """`dtype` is moderngl's name of the type: f4, u1, u2 or u4."""
        self._ctx, self._channels, self._dtype, self._texels = ctx, channels, dtype, texels
        self.texture = self._create(1)

    def reserve(self, count: int) -> None:
        """Make room for `count` entries. Raises GraphicsError if the driver has no texture that large."""
        rows = -(-count * self._texels // WIDTH)
        before = self.texture
        if rows <= before.height:
            return
        limit = self._ctx.info["GL_MAX_TEXTURE_SIZE"]
        if rows > limit:
            raise GraphicsError(
                f"{count:,} splats do not fit the largest texture of this driver ({WIDTH} × {limit}); "
                "open a smaller part of the scene"
            )
        # The first texture is only as large as the scene: most scenes never grow.
        spare = rows // SPARE_SHARE if before.height > 1 else 0
        self.texture = self._create(min(rows + spare, limit))
        _copy(self._ctx, before, self.texture)
        before.release()

    def write(self, values: ndarray, start: int) -> None:
        """Upload entries from `start` on; `values` is (n, …) with texels × channels numbers each."""
        flat = np.ascontiguousarray(values).reshape(-1, self._channels)
        for (x, y, width, height), part in _list_rectangles(start * self._texels, len(flat)):
            self.texture.write(flat[part].data, viewport=(x, y, width, height), alignment=1)

    def release(self) -> None:
        """Free the texture."""
        self.texture.release()

    def _create(self, rows: int) -> moderngl.Texture:
        texture = self._ctx.texture((WIDTH, rows), self._channels, alignment=1, dtype=self._dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture


def _list_rectangles(start: int, count: int) -> Iterator[tuple[tuple[int, int, int, int], slice]]:
    """List rectangles (x, y, width, height) that cover `count` texels from `start` on, each with its range of texels.

    They are the rest of a begun row, whole rows, and the beginning of a last row.
    """
    done = 0
    while done < count:
        y, x = divmod(start + done, WIDTH)
        left = count - done
        whole_rows = left // WIDTH if x == 0 else 0
        width, height = (WIDTH, whole_rows) if whole_rows else (min(left, WIDTH - x), 1)
        yield (x, y, width, height), slice(done, done + width * height)
        done += width * height


def _copy(ctx: moderngl.Context, source: moderngl.Texture, target: moderngl.Texture) -> None:
    """Copy all of `source` to the beginning of `target`, without leaving the GPU."""
    previous = ctx.fbo or ctx.detect_framebuffer()
    read, draw = ctx.framebuffer([source]), ctx.framebuffer([target])
    ctx.copy_framebuffer(draw, read)
    previous.use()
    read.release()
    draw.release()
