"""Preview of a scene on the CPU, as the editor shows it: colour, alpha, depth and the splat that a click selects.

A frame is made in the order `projection` (with `colors`, a `chunk` of rows at a time; `splats` is what it finds),
`tiles` (who touches which), `blend` (`tile_order` sorts for it, `scratch` is its memory, `output` writes its pictures);
`frame` puts them together.
"""

from instdrive_core.rasterize.preview.frame import DEFAULT_PICK_RULE, PickRule, Preview, blend_projected, render_preview

__all__ = ["DEFAULT_PICK_RULE", "PickRule", "Preview", "blend_projected", "render_preview"]
