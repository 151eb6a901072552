"""What stands behind a deleted thing and was never seen: continued from what photos show around, in its depth.

Photo by photo, what the ground's fill leaves open is closed: its inverse depth is the smoothest that continues that
of what stands around, which for a wall is the wall's plane; its colours are pieces of the same photo.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.behind.look_picture import (
    FACTOR,
    SKY_ALPHA,
    LookPicture,
    Remains,
    draw_look,
    fit_camera,
    shrink,
)
from instdrive_core.edits.holes.behind.open_pixels import find_open_pixels
from instdrive_core.edits.holes.behind.seen_through import PhotoDepths
from instdrive_core.edits.holes.behind.smooth_values import continue_smoothly
from instdrive_core.edits.holes.behind.surface_splats import LEAST_INVERSE, lay_splats, place_pixels
from instdrive_core.edits.holes.ground_in_photo import GroundInPhoto, project_ground
from instdrive_core.edits.holes.inpainting import ExemplarConfig, choose_source_cells
from instdrive_core.edits.holes.nearest_rows import find_nearest_rows
from instdrive_core.edits.holes.photo_evidence import MIN_COVER, Look
from instdrive_core.edits.holes.seams import blend_copies
from instdrive_core.edits.queries.photo_parts import NEAREST
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians

Plane = tuple[float, float, float]
MAX_LOOKS = 6
"""Photos from which gaps are closed around a hole in the ground."""
MIN_GAP = 12
"""Pixels: fewer are left open."""
SOLID_ALPHA = 0.7
"""Pixels that are covered more have a depth to go by."""
CLOSED_COVER = 0.95
"""A gap reaches to where more light is stopped: around it, the sky shines through what is thin …"""
TOLD_SHARE = 0.5
"""… unless photos told so much of a pixel."""
BESIDE_SHARE = 0.5
"""A wall along the line of sight begins before what stood in front of it: it may be nearer by this factor where nothing
farther stands around."""
GAP_RIM = 1
"""Coarse pixels around a gap that are closed, too."""
PIECE_REACH = 10
"""Coarse pixels around the silhouette from which pieces are taken: what stands farther off is something else."""
FOREIGN_SHARE = 0.3
"""Share of a coarse pixel from which it shows another car."""
OPACITY = 0.95
PIECES = ExemplarConfig(windows=(7, 5, 3, 1), across_penalty=1e-4, along_penalty=5e-5, reuse_penalty=1e-3, variety=0.05)


@dataclass(frozen=True)
class Backdrop:
    """Splats that stand behind a thing."""

    gaussians: Gaussians
    like: Int64[ndarray, " n"]
    """Rows of the remaining scene whose other columns they take."""


def plan_backdrop(
    remains: Remains,
    ground: Gaussians,
    plane: Plane,
    looks: tuple[Look, ...],
    rng: np.random.Generator,
    depths: PhotoDepths,
) -> Backdrop:
    """Close what photos would show of the sky behind a thing that is gone, where `ground` is filled, look by look.

    `plane` is the ground's: its height at the world's origin (metres), and its slopes along x and y.
    """
    added: list[Gaussians] = []
    for look in looks if len(remains.scene) else ():
        closed = _close_look(remains, [ground, *added], plane, look, rng, depths)
        if closed is not None and len(closed):
            added.append(closed)
    whole = concatenate_gaussians(added) if added else ground.select(np.zeros(0, np.int64))
    like = np.zeros(0, np.int64)
    if len(whole):
        still = np.flatnonzero(remains.scene.nodes == 0)
        like = still[find_nearest_rows(remains.scene.gaussians.means[still], whole.means)]
    return Backdrop(whole, like)


def _close_look(
    remains: Remains,
    fills: list[Gaussians],
    plane: Plane,
    look: Look,
    rng: np.random.Generator,
    depths: PhotoDepths,
) -> Gaussians | None:
    """Splats that close the gaps of one look; None where it has none."""
    picture = draw_look(remains, fills, fit_camera(look.camera), look.time)
    cover, coarse = shrink(picture.alpha), picture.camera.scale(1 / FACTOR)
    distance = shrink(picture.depth * picture.alpha) / np.maximum(cover, 1e-6)
    zoom = np.array(cover.shape) / np.array(look.silhouette.shape)
    silhouette = np.asarray(ndimage.zoom(look.silhouette.astype(np.float64), zoom, order=1)) > 0.25
    silhouette = silhouette[: cover.shape[0], : cover.shape[1]]
    gap = _find_gap(picture, cover, silhouette)
    if gap is None:
        return None
    close: Bool[ndarray, "a b"] = np.asarray(ndimage.binary_dilation(silhouette, iterations=PIECE_REACH), bool)
    ground = project_ground(coarse, plane)
    level = ground.find_level_pixels(distance)
    others = (shrink(picture.things) > FOREIGN_SHARE) | _find_shapes(coarse, remains.hiding)
    for nearest in (look.nearest, BESIDE_SHARE * look.nearest):
        before = (cover >= SKY_ALPHA) & (distance < nearest)
        # Neither what stands in front, nor another car, nor what shows where one is gone, is continued.
        known = ~gap & ~np.asarray(ndimage.binary_dilation((before & ~gap) | others), bool) & close
        anchored = known & (cover >= SOLID_ALPHA) & (distance > nearest)
        if (anchored & ~level).any():
            break
    gap &= ~before
    known &= (cover < SKY_ALPHA) | (cover >= CLOSED_COVER)  # mixtures stay, and are not copied
    found = _split_surfaces(ground, distance, anchored, level, gap)
    part, near, inverse = found[0]
    past, met = _count_votes(coarse, part, inverse, depths)
    found[0] = part & ~find_open_pixels(part, known, cover < SKY_ALPHA, past, met), near, inverse
    added = [
        _copy_surface(fills[0], picture, _Surface(part, known & near, inverse, cover), rng)
        for part, near, inverse in found
        if part.any()
    ]
    kept = [each for each in added if each is not None]
    return concatenate_gaussians(kept) if kept else None


def _find_gap(
    picture: LookPicture, cover: Float64[ndarray, "a b"], silhouette: Bool[ndarray, "a b"]
) -> Bool[ndarray, "a b"] | None:
    """Coarse pixels that show the sky where the thing stood, and those around them that show a mixture which no photo
    told; None where there are hardly any."""
    open_ = silhouette & (cover < MIN_COVER)
    if np.count_nonzero(open_) < MIN_GAP:
        return None
    thin = open_ | (silhouette & (cover < CLOSED_COVER) & (shrink(picture.told) < TOLD_SHARE))
    gap = ndimage.binary_propagation(open_, mask=thin)
    return np.asarray(ndimage.binary_dilation(gap, iterations=GAP_RIM), bool)


def _count_votes(
    camera: Camera, part: Bool[ndarray, "a b"], inverse: Float64[ndarray, "a b"], depths: PhotoDepths
) -> tuple[Int64[ndarray, "a b"], Int64[ndarray, "a b"]]:
    """How many photos look through what would stand in pixels at these inverse depths, and how many see it."""
    cells = np.argwhere(part & (inverse > LEAST_INVERSE))
    past, met = np.zeros(part.shape, np.int64), np.zeros(part.shape, np.int64)
    places = place_pixels(camera, cells, 1 / inverse[tuple(cells.T)])
    past[tuple(cells.T)], met[tuple(cells.T)] = depths.count_votes(places)
    return past, met


def _find_shapes(camera: Camera, points: Float64[ndarray, "k 3"]) -> Bool[ndarray, "a b"]:
    """Pixels in front of which points lie, and those between them."""
    shapes = np.zeros((camera.height, camera.width), bool)
    pixels, depths = camera.project(points)
    columns, lines = np.floor(pixels[camera.contains(pixels, depths, NEAREST)]).astype(np.int64).T
    shapes[lines, columns] = True
    return np.asarray(ndimage.binary_closing(np.pad(shapes, 2), iterations=2), bool)[2:-2, 2:-2]


def _split_surfaces(
    ground: GroundInPhoto,
    distance: Float64[ndarray, "a b"],
    anchored: Bool[ndarray, "a b"],
    level: Bool[ndarray, "a b"],
    gap: Bool[ndarray, "a b"],
) -> list[tuple[Bool[ndarray, "a b"], Bool[ndarray, "a b"], Float64[ndarray, "a b"]]]:
    """What stands behind and the ground before it: the part of the gap, where pieces are taken, inverse depths.

    What stands is continued from what stands. Ground goes on where it is nearer than that.
    """
    everywhere, inverse = np.ones_like(gap), 1 / np.maximum(distance, 1e-3)
    if not (anchored & ~level).any():
        return [(gap, everywhere, continue_smoothly(inverse, anchored, gap))]
    behind = continue_smoothly(inverse, anchored & ~level, gap)
    before = gap & (1 / ground.distances > behind)
    return [(gap & ~before, ~level, behind), (before, level, np.where(before, 1 / ground.distances, inverse))]


@dataclass(frozen=True)
class _Surface:
    """A part of a look's gap and what it is closed with, in coarse pixels."""

    gap: Bool[ndarray, "a b"]
    known: Bool[ndarray, "a b"]
    """Where pieces are taken from."""
    inverse: Float64[ndarray, "a b"]
    """Inverse depths, 1/m."""
    cover: Float64[ndarray, "a b"]


def _copy_surface(
    like: Gaussians, picture: LookPicture, surface: _Surface, rng: np.random.Generator
) -> Gaussians | None:
    """Close one part of a gap with pieces of the same photo; None where there are none."""
    gap, known = surface.gap, surface.known
    sources = choose_source_cells(
        shrink(picture.color).transpose(1, 0, 2).astype(np.float64), np.ascontiguousarray(known.T),
        np.ascontiguousarray(gap.T), rng, PIECES,
    )  # fmt: skip
    if sources is None:
        return None
    sources = sources.transpose(1, 0, 2)[..., ::-1]
    offsets = np.repeat(np.repeat(sources - np.indices(gap.shape).transpose(1, 2, 0), FACTOR, 0), FACTOR, 1) * FACTOR
    blocks = np.ones((FACTOR, FACTOR), bool)
    anchors, open_pixels = np.kron(known & (surface.cover >= SKY_ALPHA), blocks), np.kron(gap, blocks)
    blended = blend_copies(picture.color.astype(np.float64), anchors, open_pixels, offsets)
    return _lift(like, picture.camera, blended, surface, sources)


def _lift(
    like: Gaussians,
    camera: Camera,
    color: Float[ndarray, "h w 3"],
    surface: _Surface,
    sources: Int64[ndarray, "a b 2"],
) -> Gaussians:
    """A splat for each fine pixel of the gap, of the colour of its source's, at the gap's depth; none for the sky."""
    inverse, gap = surface.inverse, surface.gap
    # A source is sky as a whole: a leaf in it would be copied to each pixel that takes it.
    stands = surface.cover[tuple(sources.transpose(2, 0, 1))] >= SKY_ALPHA
    cells = np.argwhere(gap & (inverse > LEAST_INVERSE) & stands)
    offsets = np.argwhere(np.ones((FACTOR, FACTOR), bool))
    pixels = (FACTOR * cells[:, None] + offsets).reshape(-1, 2)
    means, quats, log_scales = lay_splats(camera, pixels, inverse, gap)
    count = len(pixels)
    return replace(
        like,
        means=means,
        quats=quats,
        log_scales=log_scales,
        opacity_logits=logit(np.full(count, OPACITY, np.float32)),
        sh_dc=dc_from_color(np.clip(color[tuple(pixels.T)], 0, 1)).astype(np.float32),
        sh_rest=np.zeros((count, *like.sh_rest.shape[1:]), np.float32),
        features=np.zeros((count, *like.features.shape[1:]), np.float32),
    )
