"""The pass that finds the nearest splat of every pixel, which instance views show and the cursor reads."""

from __future__ import annotations

import moderngl

from instdrive_app.render.gl.gl_state import draw_into
from instdrive_app.render.gl.programs import build_program
from instdrive_app.render.gl.projector import Projector
from instdrive_app.render.gl.splat_pass import SplatPass
from instdrive_app.render.gl.targets import Targets
from instdrive_app.state import ID_ALPHA_CUT


class IdPass:
    """Draws splats of some opacity, opaque where their alpha reaches `ID_ALPHA_CUT`, unblended; the nearest wins.

    Quads come farthest first and equal depths overwrite, so the exact order of the sort decides between splats that
    the depth buffer cannot tell apart.
    """

    def __init__(self, ctx: moderngl.Context, projector: Projector) -> None:
        self._ctx = ctx
        self._splats = SplatPass(ctx, projector, "id.frag")
        self._clear_program = build_program(ctx, "fullscreen.vert", "clear_rows.frag")
        self._clear_triangle = ctx.vertex_array(self._clear_program, [])

    def draw(self, targets: Targets, min_opacity: float) -> None:
        """Write row + 1 into `targets.rows`, 0 where there is nothing."""
        # Framebuffer.clear would write float bits into the integer target, and a picture of zeros has to be uploaded.
        with draw_into(self._ctx, targets.rows_buffer, depth_function="1"):
            self._clear_triangle.render(moderngl.TRIANGLES, vertices=3)
        with draw_into(self._ctx, targets.rows_buffer, depth_function="<="):
            self._splats.draw(targets.size, ID_ALPHA_CUT, min_opacity)

    def release(self) -> None:
        """Free the GL objects."""
        for thing in (self._splats, self._clear_triangle, self._clear_program):
            thing.release()
