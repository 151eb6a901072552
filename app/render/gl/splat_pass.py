"""The part that the colour and ID passes share: instanced quads over the projected splats."""

from __future__ import annotations

import moderngl

from instdrive_app.render.gl.programs import build_program, set_uniforms
from instdrive_app.render.gl.projector import Projector
from instdrive_core.rasterize.kernels.settings import RasterSettings

FAR = 4000.0
"""Depth (metres) at the far end of the depth buffer, which is linear."""


class SplatPass:
    """Draws every projected splat as a quad with one fragment shader."""

    def __init__(self, ctx: moderngl.Context, projector: Projector, fragment: str) -> None:
        self.program = build_program(ctx, "splat.vert", fragment)
        wanted = [("splat_center", 4), ("splat_axes", 4), ("splat_color", 3)]
        layout = " ".join(f"{n}f" if name in self.program else f"{n * 4}x" for name, n in wanted) + "/i"
        names = [name for name, _ in wanted if name in self.program]
        content = [(projector.records, layout, *names)]
        if "row" in self.program:
            content.append((projector.order, "1u/i", "row"))
        self._quads = ctx.vertex_array(self.program, content)
        self._projector = projector

    def draw(self, size: tuple[int, int], alpha_cut: float, min_opacity: float) -> None:
        """Draw into the bound framebuffer of `size` pixels, farthest splat first."""
        if not self._projector.count:
            return
        set_uniforms(
            self.program,
            viewport=size,
            alpha_cut=alpha_cut,
            min_opacity=min_opacity,
            max_alpha=RasterSettings().max_alpha,
            far=FAR,
        )
        self._quads.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=self._projector.count)

    def release(self) -> None:
        """Free program and vertex array."""
        self._quads.release()
        self.program.release()
