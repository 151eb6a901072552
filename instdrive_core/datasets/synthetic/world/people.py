"""Walking and standing people, and a cyclist. Frame: x right, y forward, z up, feet at z = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.materials import CLOTH, PLAIN, Color, Material, MaterialPalette
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import build_box, build_loft, build_sphere, build_tube

STRIDE = 1.45
"""Metres per full cycle of two steps."""

_TOPS = (
    (0.55, 0.05, 0.05), (0.06, 0.12, 0.35), (0.62, 0.60, 0.55), (0.05, 0.05, 0.06), (0.60, 0.38, 0.05),
    (0.08, 0.30, 0.14), (0.30, 0.10, 0.32), (0.10, 0.38, 0.45), (0.58, 0.22, 0.28), (0.25, 0.25, 0.27),
)  # fmt: skip
_TROUSERS = ((0.05, 0.07, 0.14), (0.03, 0.03, 0.03), (0.22, 0.19, 0.14), (0.16, 0.17, 0.19), (0.10, 0.14, 0.26))
_SKINS = ((0.60, 0.40, 0.30), (0.45, 0.28, 0.19), (0.22, 0.12, 0.08), (0.68, 0.48, 0.38))
_HAIRS = ((0.02, 0.015, 0.01), (0.10, 0.05, 0.02), (0.35, 0.23, 0.08), (0.30, 0.29, 0.28))


@dataclass(frozen=True)
class Person:
    """Looks of one person; material numbers of the street's palette."""

    height: float
    build: float
    """Factor on widths, about 1."""
    top: int
    trousers: int
    skin: int
    hair: int
    shoes: int
    bag: int
    carries: str
    """``nothing``, ``backpack``, ``bag`` or ``skirt`` (worn)."""
    phase: float
    """Radians of the walking cycle at distance 0."""

    def mesh(self, distance: float, walking: bool = True) -> TriangleMesh:
        """The person after walking `distance` metres."""
        cycle = self.phase + 2 * np.pi * distance / STRIDE
        swing = np.sin(cycle) if walking else 0.0
        lift = np.cos(cycle) if walking else 0.0
        parts = [self._torso(), self._head()]
        for side, sign in ((-1.0, 1.0), (1.0, -1.0)):
            parts.append(self._leg(side, 0.46 * sign * swing, max(0.0, sign * lift) if walking else 0.0))
            parts.append(self._arm(side, -0.5 * sign * swing))
        parts += self._luggage()
        return join_meshes(parts).scale(self.build, self.build, 1.0)

    def _leg(self, side: float, angle: float, bend: float) -> TriangleMesh:
        h = self.height
        hip = np.array([0.052 * h * side, 0.0, 0.52 * h])
        knee = hip + 0.25 * h * np.array([0, np.sin(angle + 0.25 * bend), -np.cos(angle + 0.25 * bend)])
        shin = angle - 0.55 * bend
        ankle = knee + 0.23 * h * np.array([0, np.sin(shin), -np.cos(shin)])
        ankle[2] = max(ankle[2], 0.045 * h)
        leg = build_tube([hip, knee, ankle], [0.052 * h, 0.036 * h, 0.026 * h], self.trousers, 9)
        shoe = build_box(
            (0.055 * h, 0.15 * h, 0.042 * h), ankle + h * np.array([0, 0.035, -0.022]), self.shoes, (0.8, 0.8)
        )
        return join_meshes([leg, shoe])

    def _arm(self, side: float, angle: float) -> TriangleMesh:
        h = self.height
        shoulder = np.array([0.112 * h * side, 0.0, 0.80 * h])
        elbow = shoulder + 0.165 * h * np.array([0.12 * side, np.sin(angle), -np.cos(angle)])
        lower = angle + 0.35
        hand = elbow + 0.15 * h * np.array([0.0, np.sin(lower), -np.cos(lower)])
        arm = build_tube([shoulder, elbow, hand], [0.033 * h, 0.026 * h, 0.020 * h], self.top, 8)
        return join_meshes([arm, build_sphere(hand, (0.022 * h, 0.026 * h, 0.03 * h), self.skin, 1)])

    def _torso(self) -> TriangleMesh:
        h = self.height
        rings = [  # height, half-width, half-depth
            (0.49, 0.088, 0.062), (0.56, 0.092, 0.066), (0.63, 0.082, 0.060), (0.72, 0.102, 0.068),
            (0.79, 0.118, 0.062), (0.825, 0.095, 0.050), (0.845, 0.035, 0.034), (0.88, 0.03, 0.03),
        ]  # fmt: skip
        angles = np.linspace(0, 2 * np.pi, 14, endpoint=False)
        sections = [
            np.stack([w * h * np.cos(angles), d * h * np.sin(angles), np.full(14, z * h)], axis=1) for z, w, d in rings
        ]
        return build_loft(np.stack(sections), self.top).smooth_normals(60.0)

    def _head(self) -> TriangleMesh:
        h = self.height
        face = build_sphere((0, 0.008 * h, 0.925 * h), (0.046 * h, 0.056 * h, 0.068 * h), self.skin, 2)
        hair = build_sphere((0, -0.014 * h, 0.945 * h), (0.049 * h, 0.052 * h, 0.052 * h), self.hair, 2)
        return join_meshes([face, hair])

    def _luggage(self) -> list[TriangleMesh]:
        h = self.height
        if self.carries == "backpack":
            return [build_box((0.19 * h, 0.09 * h, 0.25 * h), (0, -0.10 * h, 0.71 * h), self.bag, (0.85, 0.7))]
        if self.carries == "bag":
            return [build_box((0.05 * h, 0.17 * h, 0.15 * h), (0.155 * h, 0.0, 0.46 * h), self.bag, (0.8, 0.8))]
        if self.carries == "skirt":
            return [_build_skirt(h, self.top)]
        return []

    def cuboid(self, walking: bool) -> tuple[Float[ndarray, "3"], Float[ndarray, "3"]]:
        """(lowest, highest) corner of the box around the whole walking cycle."""
        bounds = [self.mesh(d, walking).bounds() for d in np.linspace(0, STRIDE, 5)]
        return np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)


def _build_skirt(h: float, material: int) -> TriangleMesh:
    angles = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    sections = [
        np.stack([w * h * np.cos(angles), 0.9 * w * h * np.sin(angles), np.full(14, z * h)], axis=1)
        for z, w in ((0.32, 0.135), (0.45, 0.115), (0.58, 0.085))
    ]
    return build_loft(np.stack(sections), material, capped=False).smooth_normals(60.0)


def draw_person(rng: np.random.Generator, palette: MaterialPalette) -> Person:
    """Draw a person by lot."""

    def cloth(colors: tuple[Color, ...], striped: float = 0.0) -> int:
        color = colors[rng.integers(len(colors))]
        second = (0.65, 0.65, 0.62)
        return palette.add(Material(CLOTH, color, second, variant=float(rng.random() < striped), reflectivity=0.35))

    def plain(colors: tuple[Color, ...], reflectivity: float) -> int:
        return palette.add(Material(PLAIN, colors[rng.integers(len(colors))], reflectivity=reflectivity))

    return Person(
        height=float(rng.uniform(1.56, 1.90)),
        build=float(rng.uniform(0.94, 1.16)),
        top=cloth(_TOPS, 0.25),
        trousers=cloth(_TROUSERS),
        skin=plain(_SKINS, 0.4),
        hair=plain(_HAIRS, 0.2),
        shoes=plain(((0.04, 0.03, 0.03), (0.6, 0.6, 0.6), (0.14, 0.07, 0.03)), 0.2),
        bag=cloth(((0.35, 0.05, 0.04), (0.05, 0.15, 0.12), (0.30, 0.20, 0.10), (0.04, 0.04, 0.05))),
        carries=str(rng.choice(["nothing", "nothing", "backpack", "bag", "skirt"])),
        phase=float(rng.uniform(0, 2 * np.pi)),
    )


@dataclass(frozen=True)
class Cyclist:
    """A person on a bicycle."""

    rider: Person
    frame: int
    rubber: int

    def mesh(self, distance: float) -> TriangleMesh:
        """Bicycle and rider after `distance` metres."""
        pedal = 2 * np.pi * distance / 4.5
        return join_meshes([self._bicycle(), self._body(pedal)])

    def _bicycle(self) -> TriangleMesh:
        angles = np.linspace(0, 2 * np.pi, 21)
        parts = []
        for y in (-0.52, 0.52):
            rim = [(0.0, y + 0.33 * np.cos(a), 0.34 + 0.33 * np.sin(a)) for a in angles]
            parts.append(build_tube(rim, [0.022] * 21, self.rubber, 6))
            parts.append(build_tube([(-0.05, y, 0.34), (0.05, y, 0.34)], [0.03, 0.03], self.frame, 6))
        bars = [
            ((0, -0.52, 0.34), (0, -0.18, 0.92)), ((0, -0.52, 0.34), (0, -0.06, 0.30)),
            ((0, -0.06, 0.30), (0, -0.18, 0.92)), ((0, -0.06, 0.30), (0, 0.38, 0.86)),
            ((0, -0.15, 0.80), (0, 0.38, 0.88)), ((0, 0.36, 1.02), (0, 0.52, 0.34)),
            ((-0.26, 0.36, 1.03), (0.26, 0.36, 1.03)),
        ]  # fmt: skip
        parts += [build_tube(bar, [0.02, 0.02], self.frame, 6) for bar in bars]
        parts.append(build_box((0.16, 0.26, 0.06), (0, -0.20, 0.95), self.rubber, (0.7, 0.9)))
        return join_meshes(parts)

    def _body(self, pedal: float) -> TriangleMesh:
        person = self.rider
        parts = [
            build_tube([(0, -0.20, 0.96), (0, -0.08, 1.20), (0, 0.12, 1.44)], [0.15, 0.15, 0.13], person.top, 12),
            build_tube([(0, 0.12, 1.44), (0, 0.17, 1.56)], [0.06, 0.05], person.skin, 8),
            build_sphere((0, 0.20, 1.64), (0.08, 0.10, 0.12), person.skin, 2),
            build_sphere((0, 0.185, 1.69), (0.10, 0.13, 0.09), self.frame, 2),
        ]
        for side, phase in ((-1.0, pedal), (1.0, pedal + np.pi)):
            foot = np.array([0.10 * side, -0.06 + 0.16 * np.sin(phase), 0.34 + 0.16 * np.cos(phase)])
            hip = np.array([0.08 * side, -0.20, 0.95])
            knee = 0.5 * (foot + hip) + np.array([0.02 * side, 0.24, 0.05])
            parts.append(build_tube([hip, knee, foot], [0.08, 0.06, 0.045], person.trousers, 8))
            parts.append(build_box((0.09, 0.24, 0.07), foot + np.array([0, 0.06, -0.02]), person.shoes))
            arm = [(0.17 * side, 0.12, 1.40), (0.22 * side, 0.22, 1.18), (0.22 * side, 0.36, 1.06)]
            parts.append(build_tube(arm, [0.05, 0.045, 0.035], person.top, 8))
        return join_meshes(parts)

    def cuboid(self) -> tuple[Float[ndarray, "3"], Float[ndarray, "3"]]:
        """(lowest, highest) corner of the box around a whole turn of the pedals."""
        bounds = [self.mesh(d).bounds() for d in np.linspace(0, 4.5, 5)]
        return np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)


def draw_cyclist(rng: np.random.Generator, palette: MaterialPalette) -> Cyclist:
    """Draw a person on a bicycle by lot."""
    color = _TOPS[rng.integers(len(_TOPS))]
    frame = palette.add(Material(PLAIN, color, gloss=0.2, reflectivity=0.4))
    rubber = palette.add(Material(PLAIN, (0.025, 0.025, 0.027), reflectivity=0.08))
    return Cyclist(draw_person(rng, palette), frame, rubber)
