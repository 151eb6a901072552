"""The pass that paints every splat as an ellipse with a rim."""

from __future__ import annotations

import moderngl

from instdrive_app.render.gl.gl_state import draw_into
from instdrive_app.render.gl.programs import set_uniforms
from instdrive_app.render.gl.projector import Projector
from instdrive_app.render.gl.splat_pass import SplatPass
from instdrive_app.state import ID_ALPHA_CUT
from instdrive_core.rasterize.splat_looks import INSIDE, RIM, RIM_LIGHT


class RingsPass:
    """Paints ellipses over each other, farthest first, each opaque up to where its alpha is `ID_ALPHA_CUT`."""

    def __init__(self, ctx: moderngl.Context, projector: Projector) -> None:
        self._ctx = ctx
        self._splats = SplatPass(ctx, projector, "rings.frag")

    def draw(self, target: moderngl.Framebuffer, min_opacity: float) -> None:
        """Paint onto `target` what is at least as opaque as `min_opacity`."""
        set_uniforms(self._splats.program, rim=RIM, inside=INSIDE, rim_light=RIM_LIGHT)
        with draw_into(self._ctx, target):
            self._splats.draw(target.size, ID_ALPHA_CUT, min_opacity)

    def release(self) -> None:
        """Free the GL objects."""
        self._splats.release()
