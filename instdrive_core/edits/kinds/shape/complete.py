"""Completing a thing of which one side was never seen: that side becomes the mirror image of the other one, and what
neither side shows is closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Float64, Int, Int64
from numpy import ndarray

from instdrive_core.edits.bases.append import Addition
from instdrive_core.edits.bases.growth import GrowInstance, find_main_entry, find_shown_body
from instdrive_core.edits.bases.parameters import check_number, check_number_list, is_whole
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import CONTENT, Part, fingerprint
from instdrive_core.edits.document.row_runs import RowRuns, expand_runs, make_runs
from instdrive_core.edits.document.synthetic_rows import MIRRORED, SYNTHETIC
from instdrive_core.edits.queries.closed_body import Skin, find_body
from instdrive_core.edits.queries.photo_witness import ask_photos
from instdrive_core.edits.queries.placement import find_solid
from instdrive_core.edits.queries.skin_splats import cover_skin
from instdrive_core.edits.queries.symmetry import Symmetry, find_seen_side, find_symmetry
from instdrive_core.errors import EditError
from instdrive_core.instances.oriented_box import find_main_parts
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix
from instdrive_core.maths.sh_rotation import rotate_rest
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import extract_scale
from instdrive_core.wording import phrase

FORWARD = np.pi / 2
"""Heading of what drives, in the frame of its node."""
LEAST_AGREEMENT = 0.4
"""Share of the splats with a counterpart on the other side, below which nothing is symmetric."""
LEAST_SEEN = 0.3
"""Share of the splats that photos must show where they are, for the photos to be of this thing."""
FEWEST_PHOTOS = 2
"""Photos that must show a place for it to be known."""
MOST_IN_SIGHT = 0.8
"""Share of the mirror image that photos may show to be seen already, or something else."""
FEWEST = 200
"""Solid splats from which a thing shows whether it is symmetric."""
INSET = 0.1
"""Metres by which the closing skin lies inside: behind what was seen, which it would blur."""
FAR_OUT = 0.1
"""Metres outside of the body from which splats that no photo shows are strays."""
_RUNS = ("kept", "known", "strays", "gaps")
"""Parameters that are runs of numbers."""


@dataclass(frozen=True)
class _Sides:
    """Both sides of a completed thing."""

    rows: Int64[ndarray, " m"]
    """Rows that are mirrored."""
    image: Gaussians
    kept: Int64[ndarray, " k"]
    """Rows that stay."""
    shown: Gaussians
    """Those that stay, and the image."""
    move: Float64[ndarray, "3 4"]
    """[s R | t] that puts them where they stand."""

    @cached_property
    def shell(self) -> Int64[ndarray, " n"]:
        """Which of those shown are solid and no floaters."""
        return _find_shell(self.shown, self.move)

    @cached_property
    def points(self) -> Float64[ndarray, "n 3"]:
        """Where these stand, metres."""
        return _put_out(self.shown.means[self.shell], self.move)


@dataclass(frozen=True)
class _Plan:
    """What a completion does to a document with some content."""

    key: bytes
    """Fingerprint of that content."""
    replaced: Int64[ndarray, " k"]
    """Rows that are deleted."""
    added: Gaussians
    rows: Int64[ndarray, " m"]
    """For each splat that is added, the row whose colour, codeword and place among the moves it takes."""


@dataclass
class CompleteInstance(GrowInstance):
    """Replace one side of a thing by the mirror image of its other side, marked by 3 in the column `synthetic`.

    Light and reflections are mirrored, too. The plane is given in the frame of the thing's node, as it stands now.
    What photos show of that side stays, and nothing is mirrored to where they show something else. Behind both sides
    lies a closed skin in the colours around, so that nobody looks through what was seen from neither.
    """

    kind: ClassVar[str] = "complete_instance"
    place: tuple[float, float] = (0.0, 0.0)
    """x and y of a point of the vertical plane, metres."""
    heading: float = 0.0
    """Radians from x to the direction along the plane."""
    side: int = 1
    """The side that was seen and stays: 1 to the left of the heading, -1 to the right."""
    kept: RowRuns | Int[ndarray, "_"] | Sequence[object] = ()
    """Rows of the other side that photos show; they stay. Runs as pairs (first row, number of rows)."""
    known: RowRuns | Int[ndarray, "_"] | Sequence[object] = ()
    """Rows of the seen side whose mirror image photos would show; they have none."""
    strays: RowRuns | Int[ndarray, "_"] | Sequence[object] = ()
    """Rows outside of the body, of either side, that no photo shows; they are deleted."""
    inset: float = 0.0
    """Metres by which the skin lies inside of the body; 0: there is none."""
    gaps: RowRuns | Int[ndarray, "_"] | Sequence[object] = ()
    """Places of the skin, by number, that photos look past at something behind; it is open there."""
    _plan: _Plan | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not is_whole(self.id) or self.id < 1:
            raise EditError(phrase("id {id} is not a positive whole number", id=repr(self.id)))
        x, y = check_number_list(self.place, "place", 2)
        self.place, self.heading = (x, y), check_number(self.heading, "heading")
        if self.side not in (1, -1):
            raise EditError(phrase("side {side} is neither 1 nor -1", side=self.side))
        self.inset = check_number(self.inset, "inset")
        if self.inset < 0:
            raise EditError(phrase("inset {inset} is below 0", inset=self.inset))
        for name in _RUNS:
            setattr(self, name, make_runs(getattr(self, name)))

    def to_json(self) -> dict[str, object]:
        """Kind and parameters, the rows as runs."""
        found = self.get_parameters()
        return found | {name: make_runs(getattr(self, name)).to_json() for name in _RUNS}

    @property
    def title(self) -> str:
        """``Complete instance 17``."""
        return phrase("Complete instance {id}", id=self.id)

    def prepare(self, document: Document) -> None:
        """Work out what is mirrored, which takes a fifth of a second: `do` on an equal document is then quick.

        Give a frozen copy to do this on another thread. Raises EditError where nothing is mirrored.
        """
        self._make_plan(document)

    def find_replaced(self, document: Document) -> Int64[ndarray, " k"]:
        """What is on the side that was not seen, floaters included."""
        return self._make_plan(document).replaced

    def _list_replaced(self, document: Document) -> Int64[ndarray, " k"]:
        rows = find_shown_body(document, self.id)
        there = rows[self.measure_sides(document, rows) < 0]
        there = np.setdiff1d(there, expand_runs(make_runs(self.kept), len(document.scene)))
        strays = expand_runs(make_runs(self.strays), len(document.scene))
        return np.union1d(there, np.intersect1d(rows, strays))

    def build_addition(self, document: Document) -> Addition:
        """The mirror image of the side that was seen, without floaters, and the skin behind both sides.

        Raises EditError where there is none.
        """
        scene, entry, plan = document.scene, document.scene.table[self.id], self._make_plan(document)
        added, rows = plan.added, plan.rows
        extra = {name: column[rows] for name, column in scene.extra.items()}
        extra[SYNTHETIC] = np.full(len(rows), MIRRORED, scene.extra[SYNTHETIC].dtype)
        ids, nodes = scene.instance_ids[rows], scene.nodes[rows]
        part = Scene(added, ids, scene.codewords[rows], nodes, actors=scene.actors, extra=extra)
        return Addition(part, document.colors.indices[rows], document.transforms.indices[rows], (entry,))

    def _make_plan(self, document: Document) -> _Plan:
        key = fingerprint(document, (*CONTENT, Part.VISIBILITY))
        if self._plan is not None and self._plan.key == key:
            return self._plan
        sides = self._mirror(document)
        added, rows = sides.image, sides.rows
        if self.inset:
            skin = self._build_skin(sides)
            gaps = make_runs(self.gaps).rows
            skin = skin.select(np.setdiff1d(np.arange(len(skin)), gaps))
            splats, nearest = cover_skin(skin, sides.shown.select(sides.shell), sides.points, sides.move[:, :3])
            means = _put_back(skin.places, sides.move).astype(np.float32)
            added = concatenate_gaussians([added, replace(splats, means=means)])
            rows = np.concatenate([rows, np.concatenate([sides.kept, rows])[sides.shell[nearest]]])
        self._plan = _Plan(key, self._list_replaced(document), added, rows)
        return self._plan

    def find_skin(self, document: Document) -> Float64[ndarray, "k 3"]:
        """Find the places of the skin without gaps, where the file has the splats, metres."""
        sides = self._mirror(document)
        return _put_back(self._build_skin(sides).places, sides.move)

    def _build_skin(self, sides: _Sides) -> Skin:
        return find_body(sides.points, self.plane).build_skin(self.inset)

    def _mirror(self, document: Document) -> _Sides:
        """What is there of both sides once the edit is done. Raises EditError where nothing is mirrored."""
        scene = document.scene
        body = np.setdiff1d(find_shown_body(document, self.id), expand_runs(make_runs(self.strays), len(scene)))
        rows = body[find_main_parts(document.compute_means(body).astype(np.float64))]
        rows = rows[self.measure_sides(document, rows) > 0]
        rows = np.setdiff1d(rows, expand_runs(make_runs(self.known), len(scene)))
        if not len(rows):
            raise EditError(phrase("instance {id} has nothing on that side of the plane", id=self.id))
        place = find_main_entry(document, rows)
        rows = rows[document.transforms.indices[rows] == place]
        move = document.transforms.matrices[place]
        image = mirror_gaussians(scene.gaussians.select(rows), self.plane, move)
        kept = np.setdiff1d(body, self._list_replaced(document))
        kept = kept[document.transforms.indices[kept] == place]
        shown = concatenate_gaussians([scene.gaussians.select(kept), image])
        return _Sides(rows, image, kept, shown, move)

    @property
    def plane(self) -> Symmetry:
        """The plane across which is mirrored."""
        return Symmetry(self.place, self.heading, 1.0)

    def measure_sides(self, document: Document, rows: Int64[ndarray, " k"]) -> Float64[ndarray, " k"]:
        """Measure how far rows lie on the side that was seen, metres."""
        return self.side * self.plane.measure(document.compute_means(rows).astype(np.float64))


def make_completion(document: Document, number: int) -> CompleteInstance:
    """Make the edit that completes an instance. Half a second: give a frozen copy to do this on another thread.

    Raises EditError where both sides were seen, or no plane of symmetry is found.
    """
    if number not in document.scene.table:
        raise EditError(phrase("there is no instance {id}", id=number))
    entry, gaussians = document.scene.table[number], document.scene.gaussians
    rows = find_shown_body(document, number)
    rows = rows[find_solid(sigmoid(gaussians.opacity_logits[rows]))]
    points = document.compute_means(rows).astype(np.float64)
    rows, points = rows[np.isfinite(points).all(axis=1)], points[np.isfinite(points).all(axis=1)]
    if len(rows) < FEWEST:
        raise EditError(phrase("{name} has too few splats to tell whether it is symmetric", name=entry.name))
    colors = np.clip(color_from_dc(gaussians.sh_dc[rows]), 0, 1).astype(np.float64)
    plane = find_symmetry(points, colors, FORWARD if entry.node else None)
    if plane.agreement < LEAST_AGREEMENT:
        raise EditError(
            phrase(
                "{name} does not look symmetric: {share:.0%} of it has a counterpart",
                name=entry.name,
                share=plane.agreement,
            )
        )
    side = find_seen_side(plane, points[find_main_parts(points)])
    if side == 0:
        raise EditError(phrase("both sides of {name} were seen: there is nothing to complete", name=entry.name))
    return _ask_photos(document, CompleteInstance(number, plane.place, plane.heading, side, inset=INSET), rows)


def _ask_photos(document: Document, edit: CompleteInstance, solid: Int64[ndarray, " k"]) -> CompleteInstance:
    """Add what photos say about both sides to an edit. Raises EditError where they show that its image is wrong."""
    gaussians, name = document.scene.gaussians, document.scene.table[edit.id].name
    witness = ask_photos(document, edit.id, solid)
    rows = find_shown_body(document, edit.id)
    seen, is_solid = witness.count_seen(gaussians.means[rows].astype(np.float64)), np.isin(rows, solid)
    if np.mean(seen[is_solid] >= 1) < LEAST_SEEN:  # it was added, or these are no photos of it: they say nothing
        return edit
    beside = edit.measure_sides(document, rows)
    move = document.transforms.matrices[find_main_entry(document, rows)]
    image = mirror_gaussians(gaussians.select(rows), edit.plane, move).means.astype(np.float64)
    least = min(FEWEST_PHOTOS, len(witness.looks))
    in_sight = witness.count_in_sight(image) >= least
    mirrored = beside > 0
    if np.mean(in_sight[mirrored & is_solid]) > MOST_IN_SIGHT:
        raise EditError(
            phrase("photos of {name} show that it is not symmetric across the plane that was found", name=name)
        )
    standing = document.compute_means(rows).astype(np.float64)
    shell = _find_shell(gaussians.select(rows), move)
    is_stray = (seen == 0) & (find_body(standing[shell], edit.plane).measure_outside(standing) > FAR_OUT)
    edit = replace(
        edit, kept=rows[(beside < 0) & (seen >= least)], known=rows[mirrored & in_sight], strays=rows[is_stray]
    )
    return replace(edit, gaps=np.flatnonzero(witness.count_past(edit.find_skin(document)) >= least))


def _find_shell(gaussians: Gaussians, move: Float64[ndarray, "3 4"]) -> Int64[ndarray, " k"]:
    """Which splats are solid and no floaters, where `move` puts them."""
    chosen = np.flatnonzero(find_solid(sigmoid(gaussians.opacity_logits)) & np.isfinite(gaussians.means).all(axis=1))
    return chosen[find_main_parts(_put_out(gaussians.means[chosen], move))]


def _put_out(means: Float[ndarray, "n 3"], move: Float64[ndarray, "3 4"]) -> Float64[ndarray, "n 3"]:
    """Where `move` ([s R | t]) puts means."""
    return means.astype(np.float64) @ move[:, :3].T + move[:, 3]


def _put_back(points: Float64[ndarray, "n 3"], move: Float64[ndarray, "3 4"]) -> Float64[ndarray, "n 3"]:
    """Where points were that `move` ([s R | t]) has put where they are."""
    return np.linalg.solve(move[:, :3], (points - move[:, 3]).T).T


def mirror_gaussians(gaussians: Gaussians, plane: Symmetry, move: Float64[ndarray, "3 4"]) -> Gaussians:
    """Mirror Gaussians across a plane of the frame in which `move` ([s R | t]) puts them: a Householder reflection F,
    Σ' = F Σ F, and harmonics that show along F d what they showed along d."""
    rotation = move[:, :3] / extract_scale(move)
    normal = rotation.T @ np.array([*plane.normal, 0.0])
    flip = np.eye(3) - 2 * np.outer(normal, normal)
    means = _put_back(plane.mirror(_put_out(gaussians.means, move)), move)
    # The reflected axes form a left-handed frame; turning one round leaves the ellipsoid as it is.
    turned = flip @ matrix_from_quaternion(gaussians.quats.astype(np.float64)) * np.array([-1.0, 1.0, 1.0])
    return replace(
        gaussians,
        means=means.astype(np.float32),
        quats=quaternion_from_matrix(turned).astype(np.float32),
        sh_rest=rotate_rest(gaussians.sh_rest, flip),
    )
