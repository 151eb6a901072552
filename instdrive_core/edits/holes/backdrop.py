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
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from instdrive_core.edits.holes.ground_in_photo import GroundInPhoto, project_ground
from instdrive_core.edits.holes.inpainting import ExemplarConfig, choose_source_cells
from instdrive_core.edits.holes.nearest_rows import find_nearest_rows
from instdrive_core.edits.holes.photo_evidence import MIN_COVER, Look
from instdrive_core.edits.holes.seams import blend_copies
from instdrive_core.edits.queries.compact_objects import is_compact, is_tall
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.rasterize.kernels.sky_behind import render_sky_behind
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene, place_in_world

Plane = tuple[float, float, float]
MAX_LOOKS = 6
"""Photos from which gaps are closed."""
MIN_GAP = 12
"""Pixels: fewer are left open."""
COARSE, FINE = 2, 2
FACTOR = COARSE * FINE
"""Pieces are chosen in pictures so many times smaller than a look, and copied in ones so many times larger."""
SKY_ALPHA = 0.5
"""Pixels that splats cover less show the sky: where they are copied, nothing stands."""
SOLID_ALPHA = 0.7
"""Pixels that are covered more have a depth to go by."""
BESIDE_SHARE = 0.5
"""A wall along the line of sight begins before what stood in front of it: it may be nearer by this factor where nothing
farther stands around."""
GAP_RIM = 1
"""Coarse pixels around a gap that are closed, too."""
PIECE_REACH = 10
"""Coarse pixels around the silhouette from which pieces are taken: what stands farther off is something else."""
FOREIGN_SHARE = 0.3
"""Share of a coarse pixel from which it shows another car."""
SPREAD = 0.6
"""Standard deviation of a splat in pixels."""
OPACITY = 0.95
PIECES = ExemplarConfig(windows=(7, 5, 3, 1), across_penalty=1e-4, along_penalty=5e-5, reuse_penalty=1e-3, variety=0.05)


@dataclass(frozen=True)
class Backdrop:
    """Splats that stand behind a thing."""

    gaussians: Gaussians
    like: Int64[ndarray, " n"]
    """Rows of the scene, as `plan_backdrop` was given it, whose other columns they take."""


def plan_backdrop(
    scene: Scene, ground: Gaussians, plane: Plane, looks: tuple[Look, ...], rng: np.random.Generator
) -> Backdrop:
    """Close what photos would show of the sky behind a thing that is gone from `scene`, where `ground` is filled.

    `plane` is the ground's: its height at the world's origin (metres), and its slopes along x and y.
    """
    added: list[Gaussians] = []
    for look in looks[:MAX_LOOKS]:
        closed = _close_look(scene, [ground, *added], plane, look, rng)
        if closed is not None and len(closed):
            added.append(closed)
    whole = concatenate_gaussians(added) if added else ground.select(np.zeros(0, np.int64))
    like = np.zeros(0, np.int64)
    if len(whole):
        still = np.flatnonzero(scene.nodes == 0)
        like = still[find_nearest_rows(scene.gaussians.means[still], whole.means)]
    return Backdrop(whole, like)


def _close_look(
    scene: Scene, fills: list[Gaussians], plane: Plane, look: Look, rng: np.random.Generator
) -> Gaussians | None:
    """Splats that close the gaps of one look; None where it has none."""
    camera = _fit_camera(look.camera)
    color, alpha, depth, foreign = _draw(scene, fills, camera, look.time)
    small = [_shrink(each) for each in (color, alpha, depth * alpha)]
    cover, distance = small[1], small[2] / np.maximum(small[1], 1e-6)
    zoom = np.array(cover.shape) / np.array(look.silhouette.shape)
    silhouette = np.asarray(ndimage.zoom(look.silhouette.astype(np.float64), zoom, order=1)) > 0.25
    silhouette = silhouette[: cover.shape[0], : cover.shape[1]]
    open_ = silhouette & (cover < MIN_COVER)
    if np.count_nonzero(open_) < MIN_GAP:
        return None
    gap = np.asarray(ndimage.binary_dilation(open_, iterations=GAP_RIM), bool)
    close: Bool[ndarray, "a b"] = np.asarray(ndimage.binary_dilation(silhouette, iterations=PIECE_REACH), bool)
    ground = project_ground(camera.scale(1 / FACTOR), plane)
    level, cars = ground.find_level_pixels(distance), _shrink(foreign) > FOREIGN_SHARE
    for nearest in (look.nearest, BESIDE_SHARE * look.nearest):
        before = (cover >= SKY_ALPHA) & (distance < nearest)
        # Neither what stands in front nor another car is continued.
        known = ~gap & ~np.asarray(ndimage.binary_dilation((before & ~gap) | cars), bool) & close
        anchored = known & (cover >= SOLID_ALPHA) & (distance > nearest)
        if (anchored & ~level).any():
            break
    gap &= ~before
    found = _split_surfaces(ground, distance, anchored, level, gap)
    added = [
        _copy_surface(fills[0], camera, color, alpha, _Surface(part, known & near, inverse, cover), rng)
        for part, near, inverse in found
        if part.any()
    ]
    kept = [each for each in added if each is not None]
    return concatenate_gaussians(kept) if kept else None


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
    like: Gaussians,
    camera: Camera,
    color: Float[ndarray, "h w 3"],
    alpha: Float[ndarray, "h w"],
    surface: _Surface,
    rng: np.random.Generator,
) -> Gaussians | None:
    """Close one part of a gap with pieces of the same photo; None where there are none."""
    gap, known = surface.gap, surface.known
    sources = choose_source_cells(
        _shrink(color).transpose(1, 0, 2).astype(np.float64), np.ascontiguousarray(known.T),
        np.ascontiguousarray(gap.T), rng, PIECES,
    )  # fmt: skip
    if sources is None:
        return None
    sources = sources.transpose(1, 0, 2)[..., ::-1]
    offsets = np.repeat(np.repeat(sources - np.indices(gap.shape).transpose(1, 2, 0), FACTOR, 0), FACTOR, 1) * FACTOR
    blocks = np.ones((FACTOR, FACTOR), bool)
    anchors, open_pixels = np.kron(known & (surface.cover >= SKY_ALPHA), blocks), np.kron(gap, blocks)
    blended = blend_copies(color.astype(np.float64), anchors, open_pixels, offsets)
    return _lift(like, camera, blended, alpha, gap, sources, surface.inverse)


def continue_smoothly(
    values: Float64[ndarray, "a b"], known: Bool[ndarray, "a b"], gap: Bool[ndarray, "a b"]
) -> Float64[ndarray, "a b"]:
    """Values of the gap that are the mean of their neighbours (Laplace's equation), free where nothing is known.

    Pieces of the gap that touch nothing known get 0; cells outside of the gap keep their values.
    """
    numbers = np.full(gap.shape, -1)
    numbers[gap] = np.arange(np.count_nonzero(gap))
    parts = np.zeros(gap.shape, np.int32)
    ndimage.label(gap, output=parts)
    touched = np.unique(parts[gap & np.asarray(ndimage.binary_dilation(known), bool)])
    free = gap & ~np.isin(parts, touched)
    count = int(gap.sum())
    degree, right = np.zeros(count), np.zeros(count)
    rows, columns = [], []
    for axis in (0, 1):
        for step in (-1, 1):
            neighbor = np.roll(numbers, -step, axis)
            there = np.ones(gap.shape, bool)
            edge = [slice(None), slice(None)]
            edge[axis] = slice(-1, None) if step == 1 else slice(0, 1)
            there[tuple(edge)] = False
            inside = gap & there & (neighbor >= 0)
            beside = gap & there & np.roll(known, -step, axis)
            rows.append(numbers[inside])
            columns.append(neighbor[inside])
            degree[numbers[inside]] += 1
            degree[numbers[beside]] += 1
            right[numbers[beside]] += np.roll(values, -step, axis)[beside]
    degree[numbers[free]] += 1
    diagonal = np.arange(count)
    matrix = coo_array(
        (
            np.concatenate([degree, np.full(sum(len(each) for each in rows), -1.0)]),
            (np.concatenate([diagonal, *rows]), np.concatenate([diagonal, *columns])),
        ),
        shape=(count, count),
    ).tocsc()
    result = values.copy()
    result[gap] = spsolve(matrix, right)
    return result


def _lift(
    like: Gaussians,
    camera: Camera,
    color: Float[ndarray, "h w 3"],
    alpha: Float[ndarray, "h w"],
    gap: Bool[ndarray, "a b"],
    sources: Int64[ndarray, "a b 2"],
    inverse: Float64[ndarray, "a b"],
) -> Gaussians:
    """A splat for each fine pixel of the gap, of the colour of its source's, at the gap's depth."""
    factor = FACTOR
    cells = np.argwhere(gap & (inverse > 1e-3))
    offsets = np.argwhere(np.ones((factor, factor), bool))
    pixels = (factor * cells[:, None] + offsets).reshape(-1, 2)
    origins = (factor * sources[tuple(cells.T)][:, None] + offsets).reshape(-1, 2)
    # Interpolated, so that no steps of a coarse pixel show.
    depths = 1 / np.maximum(
        ndimage.map_coordinates(
            np.where(gap | (inverse > 1e-3), inverse, 0), (pixels.T + 0.5) / factor - 0.5, order=1, mode="nearest"
        ),
        1e-3,
    )
    stands = alpha[tuple(origins.T)] >= SKY_ALPHA
    pixels, origins, depths = pixels[stands], origins[stands], depths[stands]
    x = (pixels[:, 1] + 0.5 - camera.cx) / camera.fx * depths
    y = (pixels[:, 0] + 0.5 - camera.cy) / camera.fy * depths
    pose, count = camera.world_from_camera, len(pixels)
    means = np.stack([x, y, depths], axis=1) @ pose[:3, :3].T + pose[:3, 3]
    sizes = np.log(SPREAD * depths / camera.fx)
    return replace(
        like,
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.tile(sizes[:, None], (1, 3)).astype(np.float32),
        opacity_logits=logit(np.full(count, OPACITY, np.float32)),
        sh_dc=dc_from_color(np.clip(color[tuple(pixels.T)], 0, 1)).astype(np.float32),
        sh_rest=np.zeros((count, *like.sh_rest.shape[1:]), np.float32),
        features=np.zeros((count, *like.features.shape[1:]), np.float32),
    )


def _fit_camera(camera: Camera) -> Camera:
    """The camera of a look at the fine size: whole coarse pixels, the rest cut off."""
    fine, factor = camera.scale(FINE), FACTOR
    return replace(fine, width=max(fine.width // factor, 1) * factor, height=max(fine.height // factor, 1) * factor)


def _shrink(picture: Float[ndarray, "h w *c"]) -> Float64[ndarray, "a b *c"]:
    """Mean over the fine pixels of each coarse one."""
    factor = FACTOR
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    blocks = picture.reshape(height, factor, width, factor, *picture.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3)), np.float64)


def _draw(
    scene: Scene, fills: list[Gaussians], camera: Camera, time: float
) -> tuple[Float[ndarray, "h w 3"], Float[ndarray, "h w"], Float[ndarray, "h w"], Float[ndarray, "h w"]]:
    """Colour over the sky, alpha and depth of the scene with what fills it, and where it shows compact objects."""
    poses, present = scene.find_node_poses(time, camera.lag)
    added = concatenate_gaussians(fills)
    placed = place_in_world(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
    means, quats = (np.concatenate(parts) for parts in zip(placed, (added.means, added.quats), strict=True))
    sizes, sh_dc, sh_rest = (
        np.concatenate([getattr(part, name) for part in (scene.gaussians, added)])
        for name in ("log_scales", "sh_dc", "sh_rest")
    )
    nodes = np.concatenate([scene.nodes, np.zeros(len(added), scene.nodes.dtype)])
    colors = compute_colors(means, sh_dc, sh_rest, camera.position, nodes, poses)
    opacities = np.where(present[scene.nodes], scene.gaussians.opacities, np.float32(0))
    opacities = np.concatenate([opacities, added.opacities])
    instances = np.concatenate([scene.instance_ids, np.zeros(len(added), np.uint32)])
    settings = choose_raster_settings(scene)
    frame = render_preview(means, quats, sizes, opacities, colors, camera, settings, instances=instances)
    color = frame.color + render_sky_behind(scene.sky, camera, frame.alpha)
    things = [instance.id for instance in scene.table if is_compact(instance) and not is_tall(instance)]
    shown = (frame.winner >= 0) & (frame.winner < len(scene))
    foreign = shown & np.isin(scene.instance_ids[np.where(shown, frame.winner, 0)], things)
    return color, frame.alpha, frame.depth, foreign.astype(np.float32)
