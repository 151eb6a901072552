"""Vehicle models. Frame: x right, y forward, z up, the road at z = 0 and the vehicle's middle at x = y = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.materials import (
    CAR_GLASS,
    CAR_PAINT,
    LAMP,
    PLAIN,
    POSTER,
    RIM,
    SHUTTER,
    Color,
    Material,
    MaterialPalette,
)
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import (
    add_mirror_image,
    build_box,
    build_cylinder,
    build_decal,
    build_disc,
    build_loft,
    build_quad,
)


@dataclass(frozen=True)
class CarShape:
    """Proportions of a vehicle model in metres."""

    label: str
    """PandaSet's label."""
    length: float
    width: float
    height: float
    belt: float
    """Height of the line under the side windows."""
    nose: float
    """Height of the bonnet's front edge."""
    wheelbase: float
    wheel_radius: float
    cabin: tuple[float, float, float, float]
    """y of the rear window's foot, the roof's rear end, its front end, and the windscreen's foot."""
    pillars: tuple[float, ...]
    """Divisions of the side windows, as fractions from rear to front; windows lie between neighbours."""
    clearance: float = 0.22
    tail: float = 1.0
    """Height of the rear deck as a fraction of the belt."""
    cargo: tuple[float, float, float] | None = None
    """Rear end, front end and height of a cargo box or, where lower than the belt, of an open bed."""


CAR_SHAPES = {
    "hatchback": CarShape(
        "Car", 4.05, 1.76, 1.50, 0.93, 0.78, 2.55, 0.31, (-1.98, -1.62, 0.25, 1.02), (0.04, 0.30, 0.62, 0.97)
    ),
    "sedan": CarShape(
        "Car", 4.72, 1.84, 1.45, 0.92, 0.72, 2.80, 0.33, (-1.72, -0.98, 0.35, 1.12), (0.12, 0.49, 0.96), tail=1.04
    ),
    "estate": CarShape(
        "Car", 4.80, 1.84, 1.50, 0.93, 0.74, 2.85, 0.33, (-2.32, -1.92, 0.35, 1.15), (0.04, 0.27, 0.60, 0.97)
    ),
    "suv": CarShape(
        "Car", 4.68, 1.93, 1.74, 1.08, 0.95, 2.75, 0.38, (-2.22, -1.92, 0.42, 1.05), (0.04, 0.28, 0.60, 0.97), 0.28
    ),
    "van": CarShape(
        "Car", 5.30, 2.02, 2.14, 1.16, 1.02, 3.30, 0.35, (-2.60, -2.52, 1.12, 1.88), (0.80, 0.985), 0.25
    ),
    "pickup": CarShape(
        "Pickup Truck", 5.55, 1.98, 1.84, 1.12, 1.04, 3.45, 0.40, (-0.62, -0.42, 0.92, 1.52), (0.05, 0.47, 0.96),
        0.34, cargo=(-2.62, -0.75, 1.0),
    ),
    "truck": CarShape(
        "Medium-sized Truck", 7.00, 2.26, 2.35, 1.42, 1.30, 4.00, 0.45, (1.45, 1.50, 2.75, 3.28), (0.25, 0.92),
        0.45, cargo=(-3.48, 1.25, 3.10),
    ),
}  # fmt: skip
"""Models by name."""

CAR_COLORS: tuple[Color, ...] = (
    (0.76, 0.76, 0.74), (0.045, 0.045, 0.05), (0.42, 0.43, 0.44), (0.12, 0.13, 0.14), (0.03, 0.08, 0.30),
    (0.44, 0.025, 0.025), (0.03, 0.11, 0.07), (0.50, 0.45, 0.36), (0.58, 0.20, 0.03), (0.12, 0.28, 0.42),
    (0.58, 0.44, 0.06), (0.16, 0.03, 0.06), (0.06, 0.20, 0.24), (0.24, 0.25, 0.27), (0.05, 0.06, 0.09),
    (0.20, 0.13, 0.08),
)  # fmt: skip


@dataclass(frozen=True)
class _Finish:
    """Material numbers of one vehicle."""

    paint: int
    glass: int
    black: int
    rim: int
    head: int
    tail: int
    plate: int
    cargo: int


def build_car(shape: CarShape, color: Color, rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A vehicle of the given shape and paint."""
    finish = _choose_finish(shape, color, rng, palette)
    parts = [
        _build_body(shape, finish),
        _build_cabin(shape, finish),
        _build_wheels(shape, finish),
        _build_ends(shape, finish),
    ]
    parts.append(_build_side_details(shape, finish))
    if shape.cargo is not None:
        parts.append(_build_cargo(shape, shape.cargo, finish))
    return join_meshes(parts)


def _choose_finish(shape: CarShape, color: Color, rng: np.random.Generator, palette: MaterialPalette) -> _Finish:
    spokes = float(rng.choice([5, 6, 7, 10]))
    dust = (0.30, 0.27, 0.23)
    box_color = (0.70, 0.70, 0.68) if rng.random() < 0.6 else color
    ribs = (0.75 * box_color[0], 0.75 * box_color[1], 0.75 * box_color[2])
    return _Finish(
        paint=palette.add(Material(CAR_PAINT, color, dust, shape.clearance, gloss=0.45, reflectivity=0.25)),
        glass=palette.add(Material(CAR_GLASS, (0.03, 0.035, 0.04), gloss=0.8, reflectivity=0.06)),
        black=palette.add(Material(PLAIN, (0.025, 0.025, 0.027), reflectivity=0.08)),
        rim=palette.add(
            Material(RIM, (0.45, 0.46, 0.48), (0.02, 0.02, 0.02), 0.66 * shape.wheel_radius, spokes, reflectivity=0.3)
        ),
        head=palette.add(Material(LAMP, (0.85, 0.86, 0.82), variant=0.5, gloss=0.4, reflectivity=0.7)),
        tail=palette.add(Material(LAMP, (0.55, 0.015, 0.015), variant=0.7, gloss=0.3, reflectivity=0.9)),
        plate=palette.add(
            Material(POSTER, (0.75, 0.75, 0.70), (0.05, 0.06, 0.12), 0.06, float(rng.integers(1000)), reflectivity=0.95)
        ),
        cargo=palette.add(Material(SHUTTER, box_color, ribs, 0.6, reflectivity=0.4)),
    )


def _build_body(shape: CarShape, finish: _Finish) -> TriangleMesh:
    """The lower body: cross-sections from tail to nose, with a rounded shoulder and tucked-in sills."""
    half, belt, nose, low = shape.width / 2, shape.belt, shape.nose, shape.clearance
    tail = belt * shape.tail
    hood = (shape.cabin[3] / shape.length, belt - 0.01)
    stations = [  # y / length, top, half-width, bottom
        (-0.500, 0.74 * tail, half - 0.16, low + 0.14),
        (-0.493, 0.90 * tail, half - 0.09, low + 0.06),
        (-0.470, 0.98 * tail, half - 0.035, low + 0.02),
        (-0.400, tail, half - 0.01, low),
        (-0.250, 0.5 * (tail + belt), half, low),
        (hood[0] - 0.10, belt + 0.01, half, low),
        (hood[0], hood[1], half, low),
        (0.5 * (hood[0] + 0.46), 0.45 * hood[1] + 0.55 * nose, half - 0.01, low),
        (0.460, nose, half - 0.04, low + 0.01),
        (0.488, 0.93 * nose, half - 0.10, low + 0.05),
        (0.500, 0.78 * nose, half - 0.19, low + 0.12),
    ]
    sections = [_build_body_section(y * shape.length, top, width, bottom) for y, top, width, bottom in stations]
    return build_loft(np.stack(sections), finish.paint).smooth_normals(42.0)


def _build_body_section(y: float, top: float, half: float, bottom: float) -> Float[ndarray, "p 3"]:
    rise = top - bottom
    right = [
        (half - 0.12, bottom),
        (half - 0.035, bottom + 0.10 * rise),
        (half, bottom + 0.45 * rise),
        (half - 0.012, bottom + 0.72 * rise),
        (half - 0.05, bottom + 0.94 * rise),
        (half - 0.16, top),
        (0.45 * half, top + 0.022),
    ]
    outline = right + [(-x, z) for x, z in right[::-1]]
    return np.array([(x, y, z) for x, z in outline])


def _build_cabin(shape: CarShape, finish: _Finish) -> TriangleMesh:
    """Roof and pillars as one frustum with a bevelled roof, windows laid on its faces."""
    rear, roof_rear, roof_front, front = shape.cabin
    half = shape.width / 2
    foot, top, bevel = half - 0.09, half - 0.24 if shape.height < 2 else half - 0.13, 0.07
    z0, z1, z2 = shape.belt - 0.03, shape.height - 0.06, shape.height
    base = _build_ring(foot, rear, front, z0)
    shoulder = _build_ring(top, roof_rear, roof_front, z1)
    roof = _build_ring(top - bevel, roof_rear + bevel, roof_front - bevel, z2)
    parts = [build_loft(np.stack([base, shoulder, roof]), finish.paint).smooth_normals(38.0)]
    right = np.stack([base[1], base[2], shoulder[2], shoulder[1]])
    windscreen = np.stack([base[2], base[3], shoulder[3], shoulder[2]])
    rear_window = np.stack([base[0], base[1], shoulder[1], shoulder[0]])
    surround = build_decal(right, (shape.pillars[0], shape.pillars[-1]), (0.10, 0.96), finish.black)
    parts.append(add_mirror_image(surround))
    for start, end in zip(shape.pillars, shape.pillars[1:], strict=False):
        window = build_decal(right, (start + 0.015, end - 0.015), (0.13, 0.93), finish.glass, lift=0.008)
        parts.append(add_mirror_image(window))
    parts.append(build_decal(windscreen, (0.06, 0.94), (0.05, 0.95), finish.glass))
    if shape.cargo is None or shape.cargo[2] < shape.belt:
        parts.append(build_decal(rear_window, (0.08, 0.92), (0.14, 0.92), finish.glass))
    return join_meshes(parts)


def _build_ring(half: float, rear: float, front: float, z: float) -> Float[ndarray, "4 3"]:
    """Rear left, rear right, front right, front left."""
    return np.array([[-half, rear, z], [half, rear, z], [half, front, z], [-half, front, z]])


def _build_wheels(shape: CarShape, finish: _Finish) -> TriangleMesh:
    """Tyres with rims, and black arches on the body's sides."""
    half, radius = shape.width / 2, shape.wheel_radius
    parts = []
    for y in (-shape.wheelbase / 2 - 0.02 * shape.length, shape.wheelbase / 2 - 0.02 * shape.length):
        tyre = build_cylinder((half - 0.24, y, radius), (half + 0.005, y, radius), radius, finish.black, 18)
        rim = build_disc((half + 0.012, y, radius), (1, 0, 0), 0.98 * radius, finish.rim, 18)
        angles = np.linspace(0, np.pi, 15)
        ring = np.stack([np.full(15, half + 0.004), y + 1.17 * radius * np.cos(angles),
                         np.maximum(radius + 1.17 * radius * np.sin(angles), shape.clearance)], axis=1)  # fmt: skip
        middle = np.broadcast_to([half + 0.004, y, shape.clearance + 0.01], ring[1:].shape)
        arch = build_flat_mesh(np.stack([middle, ring[:-1], ring[1:]], axis=1), finish.black)
        parts += [tyre, rim, arch]
    return add_mirror_image(join_meshes(parts))


def _build_ends(shape: CarShape, finish: _Finish) -> TriangleMesh:
    """Lamps, grille, number plates and bumpers at nose and tail."""
    half, front, nose, low = shape.width / 2, shape.length / 2, shape.nose, shape.clearance
    tail = shape.belt * shape.tail
    lamps = [
        build_box((0.40, 0.16, 0.15), (half - 0.30, front - 0.085, 0.80 * nose), finish.head, (0.9, 0.7)),
        build_box((0.16, 0.20, 0.09), (half - 0.26, front - 0.10, low + 0.20), finish.head),
    ]
    if shape.cargo is None:
        lamps.append(build_box((0.26, 0.16, 0.17), (half - 0.24, -front + 0.085, 0.80 * tail), finish.tail))
    else:
        lamps.append(build_box((0.16, 0.10, 0.30), (half - 0.12, -front + 0.04, 0.68 * shape.belt), finish.tail))
    middle = [
        build_box((shape.width * 0.46, 0.10, 0.24 * nose), (0, front - 0.045, 0.68 * nose), finish.black),
        build_box((0.50, 0.03, 0.12), (0, front + 0.005, low + 0.22), finish.plate),
        build_box((0.50, 0.03, 0.13), (0, -front - 0.003, 0.62 * tail), finish.plate),
        build_box((shape.width * 0.80, 0.16, 0.10), (0, front - 0.10, low + 0.08), finish.black),
        build_box((shape.width * 0.82, 0.16, 0.16), (0, -front + 0.075, low + 0.16), finish.black),
    ]
    return join_meshes([add_mirror_image(join_meshes(lamps)), *middle])


def _build_side_details(shape: CarShape, finish: _Finish) -> TriangleMesh:
    """Sills, door gaps, handles and mirrors."""
    half, low = shape.width / 2, shape.clearance
    rear, _, roof_front, front = shape.cabin
    sill = shape.wheelbase - 2.4 * shape.wheel_radius
    parts = [build_box((0.03, sill, 0.10), (half - 0.035, -0.02 * shape.length, low + 0.05), finish.black)]
    doors = [0.5 * (rear + front) if shape.length < 5 or shape.cargo else 0.8, front - 0.10]
    for y in doors:
        parts.append(build_box((0.012, 0.014, 0.72 * (shape.belt - low)), (half - 0.004, y, 0.53 * (low + shape.belt)),
                         finish.black))  # fmt: skip
    parts.append(build_box((0.03, 0.20, 0.035), (half, doors[0] - 0.20, shape.belt - 0.13), finish.black))
    if len(shape.pillars) > 2:
        parts.append(build_box((0.03, 0.20, 0.035), (half, front - 1.15, shape.belt - 0.13), finish.black))
    parts.append(
        build_box((0.16, 0.10, 0.14), (half + 0.03, roof_front + 0.45, shape.belt + 0.07), finish.paint, (0.8, 0.8))
    )
    return add_mirror_image(join_meshes(parts))


def _build_cargo(shape: CarShape, cargo: tuple[float, float, float], finish: _Finish) -> TriangleMesh:
    """A closed cargo box, or the inside of an open bed."""
    rear, front, top = cargo
    half, middle = shape.width / 2, 0.5 * (rear + front)
    if top < shape.belt:
        z = shape.belt * shape.tail + 0.035
        inside = np.array([[-half + 0.2, rear + 0.12, z], [half - 0.2, rear + 0.12, z],
                           [half - 0.2, front, z], [-half + 0.2, front, z]])  # fmt: skip
        return build_quad(inside, finish.black)
    floor_height = 0.95
    centre = (0, middle, 0.5 * (floor_height + top))
    closed = build_box((shape.width, front - rear, top - floor_height), centre, finish.cargo)
    frame = build_box((shape.width + 0.03, 0.06, 0.12), (0, rear, floor_height), finish.black)
    return join_meshes([closed, frame])
