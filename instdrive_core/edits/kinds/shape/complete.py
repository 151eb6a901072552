"""Completing a thing of which one side was never seen: that side becomes the mirror image of the other one."""

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
from instdrive_core.edits.document.synthetic_rows import MIRRORED, SYNTHETIC
from instdrive_core.edits.queries.placement import find_solid
from instdrive_core.edits.queries.symmetry import Symmetry, find_seen_side, find_symmetry
from instdrive_core.errors import EditError
from instdrive_core.instances.oriented_box import find_main_parts
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix
from instdrive_core.maths.sh_rotation import rotate_rest
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import extract_scale

FORWARD = np.pi / 2
"""Heading of what drives, in the frame of its node."""
LEAST_AGREEMENT = 0.4
"""Share of the splats with a counterpart on the other side, below which nothing is symmetric."""
FEWEST = 200
"""Solid splats from which a thing shows whether it is symmetric."""


@dataclass
class CompleteInstance(GrowInstance):
    """Replace one side of a thing by the mirror image of its other side, marked by 3 in the column `synthetic`.

    Light and reflections are mirrored, too. The plane is given in the frame of the thing's node, as it stands now.
    """

    kind: ClassVar[str] = "complete_instance"
    place: tuple[float, float] = (0.0, 0.0)
    """x and y of a point of the vertical plane, metres."""
    heading: float = 0.0
    """Radians from x to the direction along the plane."""
    side: int = 1
    """The side that was seen and stays: 1 to the left of the heading, -1 to the right."""

    def __post_init__(self) -> None:
        if not is_whole(self.id) or self.id < 1:
            raise EditError(f"id {self.id!r} is not a positive whole number")
        x, y = check_number_list(self.place, "place", 2)
        self.place, self.heading = (x, y), check_number(self.heading, "heading")
        if self.side not in (1, -1):
            raise EditError(f"side {self.side!r} is neither 1 nor -1")

    @property
    def title(self) -> str:
        """``Complete instance 17``."""
        return f"Complete instance {self.id}"

    def find_replaced(self, document: Document) -> Int64[ndarray, " k"]:
        """What is on the side that was not seen, floaters included."""
        rows = find_shown_body(document, self.id)
        return rows[self._measure(document, rows) < 0]

    def build_addition(self, document: Document) -> Addition:
        """The mirror image of the side that was seen, without floaters. Raises EditError where there is none."""
        scene, entry = document.scene, document.scene.table[self.id]
        rows = find_shown_body(document, self.id)
        rows = rows[find_main_parts(document.compute_means(rows).astype(np.float64))]
        rows = rows[self._measure(document, rows) > 0]
        if not len(rows):
            raise EditError(f"instance {self.id} has nothing on that side of the plane")
        rows = rows[document.transforms.indices[rows] == find_main_entry(document, rows)]
        move = document.transforms.matrices[find_main_entry(document, rows)]
        added = mirror_gaussians(scene.gaussians.select(rows), self._plane, move)
        extra = {name: column[rows] for name, column in scene.extra.items()}
        extra[SYNTHETIC] = np.full(len(rows), MIRRORED, scene.extra[SYNTHETIC].dtype)
        ids, nodes = scene.instance_ids[rows], scene.nodes[rows]
        part = Scene(added, ids, scene.codewords[rows], nodes, actors=scene.actors, extra=extra)
        return Addition(part, document.colors.indices[rows], document.transforms.indices[rows], (entry,))

    @property
    def _plane(self) -> Symmetry:
        return Symmetry(self.place, self.heading, 1.0)

    def _measure(self, document: Document, rows: Int64[ndarray, " k"]) -> Float64[ndarray, " k"]:
        """Metres into the side that was seen."""
        return self.side * self._plane.measure(document.compute_means(rows).astype(np.float64))


def make_completion(document: Document, number: int) -> CompleteInstance:
    """Make the edit that completes an instance. Half a second: give a frozen copy to do this on another thread.

    Raises EditError where both sides were seen, or no plane of symmetry is found.
    """
    if number not in document.scene.table:
        raise EditError(f"there is no instance {number}")
    entry, gaussians = document.scene.table[number], document.scene.gaussians
    rows = find_shown_body(document, number)
    rows = rows[find_solid(sigmoid(gaussians.opacity_logits[rows]))]
    points = document.compute_means(rows).astype(np.float64)
    rows, points = rows[np.isfinite(points).all(axis=1)], points[np.isfinite(points).all(axis=1)]
    if len(rows) < FEWEST:
        raise EditError(f"{entry.name} has too few splats to tell whether it is symmetric")
    colors = np.clip(color_from_dc(gaussians.sh_dc[rows]), 0, 1).astype(np.float64)
    plane = find_symmetry(points, colors, FORWARD if entry.node else None)
    if plane.agreement < LEAST_AGREEMENT:
        raise EditError(f"{entry.name} does not look symmetric: {plane.agreement:.0%} of it has a counterpart")
    side = find_seen_side(plane, points)
    if side == 0:
        raise EditError(f"both sides of {entry.name} were seen: there is nothing to complete")
    return CompleteInstance(number, plane.place, plane.heading, side)


def mirror_gaussians(gaussians: Gaussians, plane: Symmetry, move: Float64[ndarray, "3 4"]) -> Gaussians:
    """Mirror Gaussians across a plane of the frame in which `move` ([s R | t]) puts them: a Householder reflection F,
    Σ' = F Σ F, and harmonics that show along F d what they showed along d."""
    rotation = move[:, :3] / extract_scale(move)
    normal = rotation.T @ np.array([*plane.normal, 0.0])
    flip = np.eye(3) - 2 * np.outer(normal, normal)
    moved = gaussians.means.astype(np.float64) @ move[:, :3].T + move[:, 3]
    means = np.linalg.solve(move[:, :3], (plane.mirror(moved) - move[:, 3]).T).T
    # The reflected axes form a left-handed frame; turning one round leaves the ellipsoid as it is.
    turned = flip @ matrix_from_quaternion(gaussians.quats.astype(np.float64)) * np.array([-1.0, 1.0, 1.0])
    return replace(
        gaussians,
        means=means.astype(np.float32),
        quats=quaternion_from_matrix(turned).astype(np.float32),
        sh_rest=rotate_rest(gaussians.sh_rest, flip),
    )
