"""What surfaces are made of, and the palette of one street as plain arrays for the shading kernels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

# Kinds of texture, see textures.py. Plain integers, because kernels compare them.
PLAIN, ASPHALT, PAVING, BRICK, PLASTER, WINDOW, ROOF, LEAF, BARK, GRASS = range(10)
PAINTED_LINE, CAR_PAINT, CAR_GLASS, RIM, LAMP, SIGN, SHUTTER, STRIPES, WOOD, CLOTH, POSTER = range(10, 21)

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """A surface. Colours are linear-light albedo in [0, 1]."""

    kind: int
    color: Color
    second: Color = (0.0, 0.0, 0.0)
    """The other colour of two-coloured textures: joints, stripes, frames."""
    size: float = 1.0
    """Typical length of the texture in metres."""
    variant: float = 0.0
    """Chooses among forms of the same texture, e.g. a sign's face."""
    gloss: float = 0.0
    """Share of light mirrored at grazing angles; a seventh of it head-on."""
    reflectivity: float = 0.3
    """LiDAR intensity at normal incidence, [0, 1]."""
    semantic: int = 0
    """PandaSet class of LiDAR points on it, where it differs from its object's; else 0."""


@dataclass
class MaterialPalette:
    """Collects the materials of a street; a material's number is its row."""

    numbers: dict[Material, int] = field(default_factory=dict)

    def add(self, material: Material) -> int:
        """The number of `material`; equal materials share one."""
        return self.numbers.setdefault(material, len(self.numbers))

    def table(self) -> MaterialTable:
        """The palette as arrays."""
        return MaterialTable(
            np.array(
                [(m.kind, *m.color, *m.second, m.size, m.variant, m.gloss, m.reflectivity) for m in self.numbers],
                np.float32,
            ),
            np.array([m.semantic for m in self.numbers], np.uint8),
        )


@dataclass(frozen=True)
class MaterialTable:
    """A palette as arrays."""

    parameters: Float32[ndarray, "m 11"]
    """Kind, colour, second colour, size, variant, gloss, reflectivity."""
    semantics: UInt8[ndarray, " m"]
    """PandaSet class, 0 = the object's."""
