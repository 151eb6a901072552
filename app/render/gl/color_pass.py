"""The pass that blends sorted splats into colour or expected depth."""

from __future__ import annotations

import moderngl

from instdrive_app.render.gl.gl_state import PREMULTIPLIED_OVER, draw_into
from instdrive_app.render.gl.programs import set_uniforms
from instdrive_app.render.gl.projector import Projector
from instdrive_app.render.gl.splat_pass import SplatPass
from instdrive_core.rasterize.kernels.settings import RasterSettings


class ColorPass:
    """Blends splats back to front, premultiplied, over what the framebuffer holds."""

    def __init__(self, ctx: moderngl.Context, projector: Projector) -> None:
        self._ctx = ctx
        self._splats = SplatPass(ctx, projector, "color.frag")

    def draw(self, target: moderngl.Framebuffer, show_depth: bool = False) -> None:
        """Blend onto `target`; with `show_depth`, red is depth (metres) times alpha."""
        set_uniforms(self._splats.program, show_depth=show_depth)
        with draw_into(self._ctx, target, blending=PREMULTIPLIED_OVER):
            self._splats.draw(target.size, RasterSettings().min_alpha, 0.0)

    def release(self) -> None:
        """Free the GL objects."""
        self._splats.release()
