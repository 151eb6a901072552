"""Laying a shadow on the ground below a thing that was put there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.bases.append import Addition
from instdrive_core.edits.bases.growth import GrowInstance, find_main_entry, find_shown_body
from instdrive_core.edits.bases.parameters import check_number, check_number_list, is_whole
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import LEARNED_SHADOW, SHADOW, SYNTHETIC, find_marked
from instdrive_core.edits.holes.shade import (
    MAX_DARKNESS,
    SceneLight,
    Shade,
    cast_shade,
    compute_opacities,
    compute_spread,
)
from instdrive_core.edits.queries.placement import estimate_foot, find_ground_heights, find_solid
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.maths.activations import logit, sigmoid
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import extract_scale
from instdrive_core.wording import phrase

_LIFT, _THICKNESS = 0.03, 0.005
"""Metres above the ground at which the dark splats lie, and their standard deviation across it."""
_MAX_FLOAT = 0.6
"""Metres above the ground up to which a thing stands on it."""
_MIN_SLENDER = 0.1
"""Height of a thing for each metre along the ground, from which it is no surface."""
_DARK, _LEAST_DARK = 0.1, 10
"""Opacity of a learned shadow's splats that are dark, and how many of these show that there is a shadow."""
_MAX_SUN = 10.0
"""Metres of shadow for each metre of height."""


@dataclass
class LayShadow(GrowInstance):
    """Dark, flat splats of the same instance on the ground below it; they move, hide and go with it.

    A shadow that was laid for it before is replaced. Splats are marked by 2 in the column `synthetic`.
    """

    kind: ClassVar[str] = "lay_shadow"
    contact: float = 0.6
    """Share of the light that does not reach the ground below it, 0 … 0.85."""
    sun: tuple[float, float] = (0.0, 0.0)
    """Metres along the world's x and y by which the shadow lies beside what is a metre above the ground."""
    sun_share: float = 0.0
    """Share of the light that the sun's shadow takes away, 0 … 0.85."""
    softness: float = 0.2
    """Standard deviation of the edge, metres."""
    time: float = 0.0
    """Moment at which a moving thing is where the shadow is laid, seconds."""

    def __post_init__(self) -> None:
        if not is_whole(self.id) or self.id < 1:
            raise EditError(phrase("id {id} is not a positive whole number", id=repr(self.id)))
        for name in ("contact", "sun_share"):
            value = check_number(getattr(self, name), name)
            if not 0 <= value <= MAX_DARKNESS:
                raise EditError(phrase("{name} {value} is not 0 to {most}", name=name, value=value, most=MAX_DARKNESS))
            setattr(self, name, value)
        x, y = check_number_list(self.sun, "sun", 2)
        if np.hypot(x, y) > _MAX_SUN:
            raise EditError(
                phrase(
                    "sun {sun} throws shadows longer than {most:g} m for each metre of height",
                    sun=self.sun,
                    most=_MAX_SUN,
                )
            )
        self.sun = (x, y)
        self.softness, self.time = check_number(self.softness, "softness"), check_number(self.time, "time")
        if not 0.01 <= self.softness <= 2:
            raise EditError(phrase("softness {softness} is not 0.01 to 2 metres", softness=self.softness))

    @property
    def title(self) -> str:
        """``Lay shadow of instance 17``."""
        return phrase("Lay shadow of instance {id}", id=self.id)

    def find_replaced(self, document: Document) -> Int64[ndarray, " k"]:
        """The shadow that was laid before."""
        return find_shadow_rows(document, self.id)

    def build_addition(self, document: Document) -> Addition:
        """The dark splats, in the frame of the thing's node. Raises EditError where it does not stand on the ground."""
        entry = document.scene.table[self.id]
        rows = find_shown_body(document, self.id)
        rows = rows[find_solid(sigmoid(document.scene.gaussians.opacity_logits[rows]))]
        pose = self._find_pose(document, entry)
        points = document.compute_means(rows) @ pose[:3, :3].T + pose[:3, 3]
        size = np.quantile(points, 0.98, axis=0) - np.quantile(points, 0.02, axis=0)
        if size[2] < _MIN_SLENDER * size[:2].max():
            raise EditError(phrase("instance {id} is a surface, which casts no shadow of its own", id=self.id))
        plane = self._find_ground(document, points)
        heights = points[:, 2] - plane[0] - points[:, :2] @ plane[1:]
        if estimate_foot(heights) > _MAX_FLOAT:
            raise EditError(phrase("instance {id} does not stand on the ground", id=self.id))
        light = SceneLight(self.contact, self.sun, self.sun_share, self.softness)
        shade = cast_shade(np.c_[points[:, :2], heights], light)
        if not len(shade.places):
            raise EditError(phrase("instance {id} is too large to cast a shadow of its own", id=self.id))
        entry_number = find_main_entry(document, rows)
        move = document.transforms.matrices[entry_number]
        added = _build_splats(document.scene, shade, plane, _compose(pose, move), int(rows[0]))
        count = len(added)
        ids, nodes = np.full(count, self.id, np.uint32), np.full(count, entry.node, np.uint16)
        extra = {name: np.repeat(column[rows[:1]], count) for name, column in document.scene.extra.items()}
        extra[SYNTHETIC] = np.full(count, SHADOW, document.scene.extra[SYNTHETIC].dtype)
        words = np.full(count, document.scene.codewords[rows[0]], np.uint32)
        part = Scene(added, ids, words, nodes, actors=document.scene.actors, extra=extra)
        moved = np.full(count, entry_number, np.uint16)
        return Addition(part, np.zeros(count, np.uint16), moved, (entry,))

    def _find_pose(self, document: Document, entry: Instance) -> Float64[ndarray, "4 4"]:
        if not entry.node:
            return np.eye(4)
        return document.scene.actors[entry.node - 1].interpolate_pose(self.time)

    def _find_ground(self, document: Document, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "3"]:
        """The ground's height at the world's origin and its slopes; level where it is known at one place only."""
        low, high = np.quantile(points, 0.02, axis=0), np.quantile(points, 0.98, axis=0)
        corners = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]
        level = estimate_foot(points[:, 2])
        heights = find_ground_heights(document, (self.id,), np.c_[corners, np.full(4, level)])
        columns = np.c_[np.ones(4), corners]
        plane = np.linalg.lstsq(columns, heights, rcond=None)[0]
        steep = np.abs(columns @ plane - heights).max() > 0.1 or np.hypot(*plane[1:]) > 0.3
        return np.array([np.median(heights), 0.0, 0.0]) if steep else plane


def find_shadow_rows(document: Document, number: int) -> Int64[ndarray, " k"]:
    """Find the rows of the shadow that was laid below an instance and is still there."""
    rows = document.find_rows((number,))
    alive = (document.state.flags[rows] & Flag.DELETED) == 0
    return rows[alive & find_marked(document, rows, SHADOW)]


def has_learned_shadow(document: Document, number: int) -> bool:
    """Whether an instance that moves takes along a shadow that photos showed."""
    rows = document.find_rows((number,))
    rows = rows[((document.state.flags[rows] & Flag.DELETED) == 0) & find_marked(document, rows, LEARNED_SHADOW)]
    dark = sigmoid(document.scene.gaussians.opacity_logits[rows]) >= _DARK
    return bool(np.count_nonzero(dark) >= _LEAST_DARK)


def find_shadowed(document: Document) -> set[int]:
    """IDs of the instances that have a shadow which was laid."""
    if SYNTHETIC not in document.scene.extra:
        return set()
    laid = (document.scene.extra[SYNTHETIC] == SHADOW) & ((document.state.flags & Flag.DELETED) == 0)
    return set(np.unique(document.scene.instance_ids[laid]).tolist())


def make_lay_shadow(number: int, light: SceneLight, time: float) -> LayShadow:
    """The edit that lays an instance's shadow in the light of the scene."""
    return LayShadow(number, light.contact, light.sun, light.sun_share, light.softness, time)


def _compose(pose: Float64[ndarray, "4 4"], move: Float64[ndarray, "3 4"]) -> Float64[ndarray, "3 4"]:
    """[s R | t] from where the file has splats to the world."""
    return (pose @ np.vstack([move, [0.0, 0.0, 0.0, 1.0]]))[:3]


def _build_splats(
    scene: Scene, shade: Shade, plane: Float64[ndarray, "3"], placed: Float64[ndarray, "3 4"], like: int
) -> Gaussians:
    """Black splats along the ground, as the file has them before they are `placed` ([s R | t]); columns that do not
    matter are those of the row `like`."""
    count = len(shade.places)
    places = np.c_[shade.places, plane[0] + shade.places @ plane[1:] + _LIFT]
    normal = np.array([-plane[1], -plane[2], 1.0])
    normal /= np.linalg.norm(normal)
    side = np.cross([0.0, 1.0, 0.0], normal)
    side /= np.linalg.norm(side)
    scale = extract_scale(placed)
    turned = (placed[:, :3] / scale).T @ np.stack([side, np.cross(normal, side), normal], axis=1)
    sizes = np.array([compute_spread(), compute_spread(), _THICKNESS]) / scale
    base = scene.gaussians.select(np.full(count, like))
    return replace(
        base,
        means=((places - placed[:, 3]) @ placed[:, :3] / scale**2).astype(np.float32),
        quats=np.tile(quaternion_from_matrix(turned), (count, 1)).astype(np.float32),
        log_scales=np.tile(np.log(sizes), (count, 1)).astype(np.float32),
        opacity_logits=logit(compute_opacities(shade).astype(np.float32)),
        sh_dc=np.tile(dc_from_color(np.zeros((1, 3))), (count, 1)).astype(np.float32),
        sh_rest=np.zeros_like(base.sh_rest),
    )
