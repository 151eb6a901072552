"""The pass that outlines and tints what is selected and outlines what is hovered."""

from __future__ import annotations

import moderngl

from instdrive_app.render.gl.gl_state import PREMULTIPLIED_OVER, draw_into
from instdrive_app.render.gl.gpu_scene import GpuScene
from instdrive_app.render.gl.programs import build_program, set_uniforms
from instdrive_app.render.gl.splat_textures import WIDTH
from instdrive_app.render.gl.targets import Targets
from instdrive_app.render.picture_colors import HOVERED_LINE, SELECTED_LINE, SELECTED_TINT
from instdrive_core.scene.selection import Flag


class OutlinePass:
    """Marks pixels by the splat that they show, then blends lines and tint over the picture."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._mask_program = build_program(ctx, "fullscreen.vert", "mask.frag")
        self._line_program = build_program(ctx, "fullscreen.vert", "outline.frag")
        self._mask_triangle = ctx.vertex_array(self._mask_program, [])
        self._line_triangle = ctx.vertex_array(self._line_program, [])

    def draw(self, targets: Targets, scene: GpuScene, hovered: int, tint: bool, thickness: int) -> None:
        """Draw over `targets.shown`, reading `targets.rows`. `hovered` is an ID or 0; without `tint` only lines."""
        for unit, texture in enumerate((targets.rows, scene.instance_ids.texture, scene.states.texture)):
            texture.use(unit)
        set_uniforms(
            self._mask_program,
            rows=0,
            instance_ids=1,
            states=2,
            texture_width=WIDTH,
            selected_flag=int(Flag.SELECTED),
            hovered_id=hovered,
        )
        with draw_into(self._ctx, targets.mask_buffer):
            self._mask_triangle.render(moderngl.TRIANGLES, vertices=3)
        targets.mask.use(0)
        set_uniforms(
            self._line_program,
            mask=0,
            selected_line=SELECTED_LINE,
            selected_tint=SELECTED_TINT if tint else (0.0, 0.0, 0.0, 0.0),
            hovered_line=HOVERED_LINE,
            thickness=thickness,
        )
        with draw_into(self._ctx, targets.shown_buffer, blending=PREMULTIPLIED_OVER):
            self._line_triangle.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GL objects."""
        for thing in (self._mask_triangle, self._line_triangle, self._mask_program, self._line_program):
            thing.release()
