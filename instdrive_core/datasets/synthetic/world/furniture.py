"""What stands on pavements. Frame: z up from the ground; what has a face shows it to −y."""

from __future__ import annotations

import numpy as np

from instdrive_core.datasets.synthetic.world.materials import (
    CAR_GLASS,
    LAMP,
    PLAIN,
    POSTER,
    SHUTTER,
    SIGN,
    STRIPES,
    WOOD,
    Color,
    Material,
    MaterialPalette,
)
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_flat_mesh, join_meshes
from instdrive_core.datasets.synthetic.world.primitives import (
    build_box,
    build_cylinder,
    build_disc,
    build_quad,
    build_sphere,
    build_tube,
)

_SIGN_COLORS: dict[int, tuple[Color, Color]] = {
    0: ((0.50, 0.02, 0.02), (0.5, 0.02, 0.02)),
    1: ((0.02, 0.09, 0.40), (0.8, 0.8, 0.8)),
    2: ((0.02, 0.09, 0.40), (0.50, 0.02, 0.02)),
    3: ((0.02, 0.09, 0.40), (0.8, 0.8, 0.8)),
    4: ((0.50, 0.02, 0.02), (0.8, 0.8, 0.8)),
}
"""Ground and second colour of the faces in textures.sign_face."""
ROAD_SIGNS = (0, 1, 2, 4)
CROSSWALK_SIGN = 3
_SQUARE_SIGNS = (1, 3)


def _add_metal(palette: MaterialPalette, color: Color = (0.22, 0.23, 0.24)) -> int:
    return palette.add(Material(PLAIN, color, gloss=0.08, reflectivity=0.35))


def build_lamp_post(rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A street lamp whose arm reaches towards −y."""
    metal = _add_metal(palette, (0.10, 0.12, 0.11) if rng.random() < 0.5 else (0.30, 0.31, 0.31))
    glow = palette.add(Material(LAMP, (0.8, 0.78, 0.68), variant=0.4, reflectivity=0.5))
    height = rng.uniform(6.2, 7.2)
    return join_meshes(
        [
            build_cylinder((0, 0, 0), (0, 0, 0.9), 0.12, metal, 10),
            build_cylinder((0, 0, 0.9), (0, 0, height), 0.075, metal, 10, 0.05),
            build_tube(
                [(0, 0, height - 0.1), (0, -0.5, height + 0.35), (0, -1.7, height + 0.45)], [0.05] * 3, metal, 8
            ),
            build_box((0.26, 0.75, 0.12), (0, -1.9, height + 0.45), metal, (0.7, 0.9)),
            build_box((0.18, 0.55, 0.03), (0, -1.9, height + 0.38), glow),
        ]
    )


def build_traffic_light(palette: MaterialPalette, green: bool) -> TriangleMesh:
    """A signal head on a post; its lamps face −y."""
    metal = _add_metal(palette, (0.12, 0.13, 0.12))
    black = palette.add(Material(PLAIN, (0.02, 0.02, 0.02), reflectivity=0.1))
    parts = [
        build_cylinder((0, 0, 0), (0, 0, 3.5), 0.07, metal, 10),
        build_box((0.36, 0.22, 1.0), (0, -0.16, 3.0), black),
        build_box((0.58, 0.03, 1.22), (0, -0.03, 3.0), black),
    ]
    colors = ((0.6, 0.02, 0.02), (0.6, 0.35, 0.02), (0.03, 0.6, 0.25))
    for row, color in enumerate(colors):
        on = row == (2 if green else 0)
        dim = color if on else tuple(0.12 * value for value in color)
        lamp = palette.add(Material(LAMP, dim, variant=1.6 if on else 0.0, reflectivity=0.3))  # type: ignore[arg-type]
        z = 3.32 - 0.32 * row
        parts.append(build_disc((0, -0.28, z), (0, -1, 0), 0.115, lamp))
        parts.append(build_box((0.26, 0.16, 0.02), (0, -0.33, z + 0.13), black))
    return join_meshes(parts)


def build_traffic_sign(face: int, rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A sign on a post; `face` as in textures.sign_face."""
    post, grey = (
        _add_metal(palette, (0.35, 0.36, 0.36)),
        palette.add(Material(PLAIN, (0.3, 0.3, 0.3), reflectivity=0.4)),
    )
    ground, second = _SIGN_COLORS[face]
    radius = 0.36
    material = palette.add(Material(SIGN, ground, second, radius, float(face), reflectivity=0.95))
    z = rng.uniform(2.3, 2.6)
    parts = [build_cylinder((0, 0.05, 0), (0, 0.05, z + 0.3), 0.035, post, 8)]
    if face in _SQUARE_SIGNS:
        parts += _build_plate(radius, z, material, grey)
    else:
        parts.append(build_disc((0, -0.012, z), (0, -1, 0), radius, material, 24))
        parts.append(build_disc((0, 0.008, z), (0, 1, 0), radius, grey, 24))
    return join_meshes(parts)


def _build_plate(half: float, z: float, front: int, back: int) -> list[TriangleMesh]:
    corners = np.array([[-half, z - half], [half, z - half], [half, z + half], [-half, z + half]])
    face = np.column_stack([corners[:, 0], np.full(4, -0.012), corners[:, 1]])
    texture = np.column_stack([corners[:, 0], corners[:, 1] - z, np.zeros(4)])
    index = np.array([[0, 1, 2], [0, 2, 3]])
    behind = face[::-1] + np.array([0, 0.02, 0])
    return [build_flat_mesh(face[index], front, texture[index]), build_quad(behind, back)]


def build_litter_bin(rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A round litter bin or a wheeled one."""
    color = ((0.04, 0.16, 0.08), (0.05, 0.09, 0.22), (0.12, 0.12, 0.13), (0.30, 0.20, 0.03))[rng.integers(4)]
    body = palette.add(Material(PLAIN, color, reflectivity=0.3))
    black = palette.add(Material(PLAIN, (0.02, 0.02, 0.02)))
    if rng.random() < 0.5:
        return join_meshes(
            [
                build_cylinder((0, 0, 0.05), (0, 0, 0.95), 0.25, body, 14, 0.28),
                build_cylinder((0, 0, 0.95), (0, 0, 1.08), 0.30, black, 14, 0.16),
            ]
        )
    wheel = [build_cylinder((x, 0.25, 0.1), (x + 0.05, 0.25, 0.1), 0.1, black, 10) for x in (-0.28, 0.23)]
    lid = build_box((0.58, 0.72, 0.07), (0, 0, 1.05), black, (0.95, 0.95))
    return join_meshes([build_box((0.48, 0.58, 0.95), (0, 0, 0.545), body, (1.15, 1.15)), lid, *wheel])


def build_hydrant(palette: MaterialPalette) -> TriangleMesh:
    """A fire hydrant."""
    red = palette.add(Material(PLAIN, (0.50, 0.04, 0.02), gloss=0.15, reflectivity=0.4))
    cap = palette.add(Material(PLAIN, (0.60, 0.50, 0.10), gloss=0.15, reflectivity=0.4))
    return join_meshes(
        [
            build_cylinder((0, 0, 0), (0, 0, 0.08), 0.20, red, 12),
            build_cylinder((0, 0, 0.08), (0, 0, 0.62), 0.13, red, 12),
            build_sphere((0, 0, 0.64), (0.155, 0.155, 0.15), cap, 1),
            build_cylinder((-0.23, 0, 0.45), (0.23, 0, 0.45), 0.065, cap, 10),
            build_cylinder((0, -0.22, 0.42), (0, 0, 0.42), 0.085, cap, 10),
        ]
    )


def build_bench(palette: MaterialPalette) -> TriangleMesh:
    """A bench that faces −y."""
    wood = palette.add(Material(WOOD, (0.34, 0.19, 0.08), size=0.6, reflectivity=0.35))
    iron = _add_metal(palette, (0.05, 0.05, 0.05))
    slats = [build_box((1.7, 0.11, 0.04), (0, y, 0.45), wood) for y in (-0.22, -0.08, 0.06)]
    back = [build_box((1.7, 0.03, 0.12), (0, 0.17 + 0.04 * k, 0.60 + 0.17 * k), wood) for k in range(3)]
    legs = []
    for x in (-0.7, 0.7):
        legs += [
            build_box((0.06, 0.42, 0.05), (x, -0.06, 0.41), iron),
            build_box((0.06, 0.05, 0.42), (x, -0.24, 0.21), iron),
        ]
        legs.append(build_box((0.06, 0.05, 1.0), (x, 0.18, 0.5), iron))
    return join_meshes([*slats, *back, *legs])


def build_post_box(palette: MaterialPalette) -> TriangleMesh:
    """A letter box on a foot."""
    color = palette.add(Material(PLAIN, (0.62, 0.42, 0.02), gloss=0.1, reflectivity=0.4))
    black = palette.add(Material(PLAIN, (0.02, 0.02, 0.02)))
    return join_meshes(
        [
            build_box((0.10, 0.10, 0.70), (0, 0, 0.35), black),
            build_box((0.52, 0.38, 0.62), (0, 0, 1.01), color),
            build_box((0.38, 0.02, 0.05), (0, -0.195, 1.20), black),
        ]
    )


def build_planter(palette: MaterialPalette) -> TriangleMesh:
    """The tub of a planter, 0.9 m square; put a bush on it."""
    concrete = palette.add(Material(PLAIN, (0.42, 0.40, 0.37), reflectivity=0.45))
    return build_box((0.78, 0.78, 0.52), (0, 0, 0.26), concrete, (1.15, 1.15))


def build_bus_shelter(rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """A shelter open to −y, 3.6 m wide, with a poster at its side."""
    metal = _add_metal(palette, (0.14, 0.15, 0.16))
    glass = palette.add(Material(CAR_GLASS, (0.16, 0.20, 0.21), gloss=0.5, reflectivity=0.1))
    advert = palette.add(
        Material(POSTER, (0.05, 0.32, 0.42), (0.80, 0.72, 0.20), 0.24, float(rng.integers(1000)), reflectivity=0.5)
    )
    wood = palette.add(Material(WOOD, (0.34, 0.19, 0.08), size=0.6, reflectivity=0.35))
    posts = [build_box((0.07, 0.07, 2.4), (x, y, 1.2), metal) for x in (-1.75, 1.75) for y in (-0.42, 0.4)]
    panels = [
        build_box((3.4, 0.03, 1.75), (0, 0.4, 1.25), glass),
        build_box((0.10, 0.8, 1.9), (1.75, 0, 1.25), metal),
        build_quad([(1.69, -0.35, 0.4), (1.69, 0.35, 0.4), (1.69, 0.35, 2.1), (1.69, -0.35, 2.1)], advert),
        build_quad([(1.81, 0.35, 0.4), (1.81, -0.35, 0.4), (1.81, -0.35, 2.1), (1.81, 0.35, 2.1)], advert),
        build_box((3.8, 1.1, 0.12), (0, 0, 2.45), metal),
        build_box((2.4, 0.34, 0.05), (-0.3, 0.18, 0.5), wood),
        build_box((0.06, 0.2, 0.5), (-1.2, 0.18, 0.25), metal),
        build_box((0.06, 0.2, 0.5), (0.6, 0.18, 0.25), metal),
    ]
    return join_meshes([*posts, *panels])


def build_cone(palette: MaterialPalette) -> TriangleMesh:
    """A traffic cone."""
    orange = palette.add(Material(PLAIN, (0.75, 0.16, 0.02), reflectivity=0.5))
    white = palette.add(Material(PLAIN, (0.80, 0.80, 0.80), reflectivity=0.95))
    return join_meshes(
        [
            build_box((0.38, 0.38, 0.04), (0, 0, 0.02), orange),
            build_cylinder((0, 0, 0.04), (0, 0, 0.30), 0.14, orange, 14, 0.095),
            build_cylinder((0, 0, 0.30), (0, 0, 0.48), 0.095, white, 14, 0.065),
            build_cylinder((0, 0, 0.48), (0, 0, 0.70), 0.065, orange, 14, 0.03),
        ]
    )


def build_barrier(palette: MaterialPalette) -> TriangleMesh:
    """A works barrier 1.6 m wide, striped towards both sides."""
    stripes = palette.add(Material(STRIPES, (0.60, 0.03, 0.02), (0.80, 0.80, 0.80), 0.4, reflectivity=0.9))
    grey = _add_metal(palette)
    legs = [build_box((0.06, 0.5, 0.06), (x, 0, 0.03), grey) for x in (-0.7, 0.7)]
    legs += [build_box((0.05, 0.05, 1.0), (x, 0, 0.5), grey) for x in (-0.7, 0.7)]
    return join_meshes(
        [build_box((1.6, 0.04, 0.24), (0, 0, 0.85), stripes), build_box((1.6, 0.04, 0.2), (0, 0, 0.4), stripes), *legs]
    )


def build_kiosk(rng: np.random.Generator, palette: MaterialPalette) -> TriangleMesh:
    """An advertising column."""
    advert = palette.add(
        Material(POSTER, (0.62, 0.55, 0.40), (0.40, 0.05, 0.10), 0.2, float(rng.integers(1000)), reflectivity=0.4)
    )
    green = palette.add(Material(SHUTTER, (0.05, 0.16, 0.11), (0.03, 0.08, 0.06), 0.2, reflectivity=0.3))
    side = [
        build_quad([(0.45 * np.sin(a), -0.45 * np.cos(a), 0.5), (0.45 * np.sin(b), -0.45 * np.cos(b), 0.5),
              (0.45 * np.sin(b), -0.45 * np.cos(b), 2.6), (0.45 * np.sin(a), -0.45 * np.cos(a), 2.6)], advert)
        for a, b in zip(np.arange(12) * np.pi / 6, (np.arange(12) + 1) * np.pi / 6, strict=True)
    ]  # fmt: skip
    return join_meshes(
        [
            build_cylinder((0, 0, 0), (0, 0, 0.5), 0.48, green, 16),
            *side,
            build_cylinder((0, 0, 2.6), (0, 0, 2.75), 0.54, green, 16),
            build_cylinder((0, 0, 2.75), (0, 0, 3.25), 0.42, green, 16, 0.05),
        ]
    )
