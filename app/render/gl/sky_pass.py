"""The pass that fills the background with the sky or a plain backdrop."""

from __future__ import annotations

import moderngl

from instdrive_app.render.gl.gl_state import draw_into
from instdrive_app.render.gl.programs import build_program, set_uniforms
from instdrive_app.render.picture_colors import BACKDROP
from instdrive_core.scene.camera import Camera


class SkyPass:
    """Fills a framebuffer with the colour behind everything, alpha 0."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._program = build_program(ctx, "fullscreen.vert", "sky.frag")
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(
        self,
        target: moderngl.Framebuffer,
        camera: Camera,
        faces: moderngl.TextureArray | None,
        backdrop: tuple[float, float, float] = BACKDROP,
    ) -> None:
        """Draw the cube map as `camera` sees it; without faces, fill with `backdrop`."""
        if faces is None:
            target.clear(*backdrop, 0.0)
            return
        faces.use(0)
        set_uniforms(
            self._program,
            faces=0,
            world_from_camera=tuple(camera.world_from_camera[:3, :3].T.ravel()),
            focal=(camera.fx, camera.fy),
            principal=(camera.cx, camera.cy),
        )
        with draw_into(self._ctx, target):
            self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GL objects."""
        self._triangle.release()
        self._program.release()
