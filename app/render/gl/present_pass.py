"""The pass that turns blended colour, blended depth or splat rows into the viewport's opaque picture."""

from __future__ import annotations

import moderngl

from instdrive_app.preferences.instance_colors import SAFE_COLORS
from instdrive_app.render.gl.gl_state import draw_into
from instdrive_app.render.gl.gpu_scene import GpuScene
from instdrive_app.render.gl.programs import build_program, set_uniforms
from instdrive_app.render.gl.splat_textures import WIDTH
from instdrive_app.render.gl.targets import Targets
from instdrive_app.render.picture_colors import DEPTH_RAMP
from instdrive_app.state import ViewMode

_SAFE_COLORS = tuple(map(tuple, (SAFE_COLORS / 255).tolist()))
_VIEWS = {
    ViewMode.COLOR: 0,
    ViewMode.DEPTH: 1,
    ViewMode.INSTANCE: 2,
    ViewMode.CODEWORD: 2,
    ViewMode.CENTERS: 0,
    ViewMode.RINGS: 0,
}


class PresentPass:
    """Writes `targets.shown`, alpha 1 everywhere."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._program = build_program(ctx, "fullscreen.vert", "present.frag")
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(
        self, targets: Targets, scene: GpuScene, mode: ViewMode, depth_range: tuple[float, float], safe_colors: bool
    ) -> None:
        """Paint the picture of one view mode."""
        ids = scene.codewords if mode is ViewMode.CODEWORD else scene.instance_ids
        targets.blended.use(0)
        targets.rows.use(1)
        ids.texture.use(2)
        set_uniforms(
            self._program,
            view=_VIEWS[mode],
            viewport=targets.size,
            blended=0,
            rows=1,
            ids=2,
            texture_width=WIDTH,
            ramp=DEPTH_RAMP,
            has_safe_colors=safe_colors,
            safe_colors=_SAFE_COLORS,
            depth_range=depth_range,
        )
        with draw_into(self._ctx, targets.shown_buffer):
            self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GL objects."""
        self._triangle.release()
        self._program.release()
