"""Masks as segmenters really make them (``sam-v2``): faults that repeat over photos, in two overlapping layers.

Large objects fall into parts, a third of the photo lies in no mask, shadows are masks, pairs of objects are one mask
for runs of photos. What happens to an object, a part or a pair is a hash of it, so that it happens in every photo; some
answers are drawn anew in each photo.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int64, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.synthetic.units import GROUND, HOUSE, PERSON, VEGETATION, VEHICLE, PixelUnits
from instdrive_core.masks.faults.draws import RepeatedDraws
from instdrive_core.masks.faults.ragged_borders import draw_border_shifts, shift_labels
from instdrive_core.maths.streams import Stream, make_generator

REFERENCE_WIDTH = 480
"""Width in pixels of the photos that thresholds in pixels are meant for."""
GRID = 15
"""Pixels between the points at which a segmenter is asked: a region without one gets no mask."""
BLOCK_STEPS = 5
"""Time steps of a run in which wholes and merged pairs stay as they are."""
GRAIN = 4
"""Pixels along a border after which it moves otherwise."""
_SMALLEST = 12
"""Pixels below which nothing is a mask."""
_EVER_MERGED = 0.4
"""Share of the pairs of objects that are ever merged."""
_OWN_SHADOW, _JOINED_SHADOW = 0.4, 0.4
"""Share of the cast shadows that are masks of their own, and of those of vehicles and people that join their caster."""
_SPLIT_UNITS = 0.5
"""Share of the objects and parts whose pieces, where something stands before them, become masks of their own."""


@dataclass(frozen=True)
class RepeatedFaults:
    """How often each fault occurs."""

    parts_above: tuple[float, float]
    """Range of √(visible pixels) above which an object shows coarse parts, drawn per object evenly in its logarithm."""
    part_found: float
    """Share of the parts that have a mask."""
    whole_found: float
    """Share in which the whole object has a mask beside its parts; per camera and run of steps."""
    unmasked: float
    """Scale of the shares of ground cells (0.40) and parts of houses and plants (0.35) that no mask covers."""
    missed: float
    """Share of the things that are never found, and of those that are missed in a photo."""
    merged: float
    """Share of touching pairs that are one mask; per camera and run of steps."""
    flip: float
    """Share of all answers that are drawn anew in each photo."""
    ragged: float = 2.0
    """Largest distance in pixels by which a border moves."""


MILD = RepeatedFaults((80, 240), 0.6, 0.85, 0.75, 0.03, 0.06, 0.10)
MEDIUM = RepeatedFaults((40, 160), 0.7, 0.7, 1.0, 0.05, 0.12, 0.10)
STRONG = RepeatedFaults((20, 100), 0.85, 0.5, 1.4, 0.08, 0.20, 0.15)


@dataclass(frozen=True)
class _Photo:
    """One photo while its masks are made."""

    units: PixelUnits
    families: Int64[ndarray, " o"]
    is_thing: Bool[ndarray, " o"]
    draws: RepeatedDraws
    run: tuple[int, int]
    """Camera and run of steps, as keys of draws."""
    scale: float
    """Width over that of the reference."""
    faults: RepeatedFaults


@dataclass(frozen=True)
class _Region:
    mask: Bool[ndarray, "h w"]
    splits: bool
    """Whether its pieces, where something stands before it, are masks of their own."""


def make_segmenter_masks(
    units: PixelUnits,
    families: Int64[ndarray, " o"],
    is_thing: Bool[ndarray, " o"],
    faults: RepeatedFaults,
    camera: int,
    step: int,
    key: str,
    seed: int,
) -> tuple[tuple[UInt32[ndarray, "h w"], UInt32[ndarray, "h w"]], Bool[ndarray, "h w"]]:
    """Make the masks that a segmenter would give for a photo of the synthetic street.

    Args:
        units: what the photo shows.
        families: of each object, by instance ID (`units.GROUND`, …).
        is_thing: of each object.
        faults: how often each occurs.
        camera: number of the camera.
        step: time step.
        key: of the photo.
        seed: of all draws.

    Returns two label maps, 0 = none: where masks overlap, the first shows the smallest, the second the largest. Beside
    them the sky. Borders of all three are ragged alike.
    """
    draws = RepeatedDraws(seed, key, faults.flip)
    scale = units.objects.shape[1] / REFERENCE_WIDTH
    photo = _Photo(units, families, is_thing, draws, (camera, step // BLOCK_STEPS), scale, faults)
    covered = ~_find_unmasked(photo)
    regions = [_Region(region.mask & covered, region.splits) for region in _merge_wholes(photo, _find_wholes(photo))]
    regions += [_Region(region.mask & covered, region.splits) for region in _find_parts(photo)]
    regions += _find_own_shadows(photo)
    masks = [mask for region in regions for mask in _ask_grid(region, scale)]
    sizes = [int(mask.sum()) for mask in masks]
    small_on_top, large_on_top = (np.zeros(units.objects.shape, np.uint32) for _ in range(2))
    for number in np.argsort([-size for size in sizes], kind="stable"):
        small_on_top[masks[number]] = number + 1
    for number in np.argsort(sizes, kind="stable"):
        large_on_top[masks[number]] = number + 1
    rng = make_generator(seed, Stream.MASK_FAULTS, zlib.crc32(key.encode()))
    shifts = draw_border_shifts(*units.objects.shape, faults.ragged * scale, max(1, round(GRAIN * scale)), rng)
    small_on_top, large_on_top = (shift_labels(labels, shifts) for labels in (small_on_top, large_on_top))
    return (small_on_top, large_on_top), shift_labels(units.objects == 0, shifts)


def _find_unmasked(photo: _Photo) -> Bool[ndarray, "h w"]:
    """Regions that no mask covers: cells of the ground, parts of houses and plants."""
    units, scale = photo.units, photo.faults.unmasked
    family = photo.families[units.objects]
    result = np.zeros(units.objects.shape, bool)
    ground = family == GROUND
    result[ground] = photo.draws.draw("unmasked ground", units.cells[ground]) < 0.40 * scale
    built = (family == HOUSE) | (family == VEGETATION)
    result[built] = photo.draws.draw("unmasked part", units.objects[built], units.fine[built]) < 0.35 * scale
    return result


def _find_visible_objects(photo: _Photo) -> tuple[Int64[ndarray, " k"], Int64[ndarray, " k"]]:
    """Objects that the photo shows and the segmenter does not miss, and their pixels."""
    areas = np.bincount(photo.units.objects.ravel(), minlength=len(photo.families))
    objects = np.flatnonzero(areas)
    objects = objects[objects > 0]
    missed = photo.draws.draw("always missed", objects) < photo.faults.missed
    missed |= photo.draws.draw_once("missed here", objects) < photo.faults.missed
    objects = objects[~(missed & photo.is_thing[objects])]
    return objects, areas[objects]


def _find_levels(photo: _Photo) -> tuple[Int64[ndarray, " k"], Int64[ndarray, " k"], Int64[ndarray, " k"]]:
    """Objects, the level of parts that each shows (0 = none, 1 = coarse, 2 = fine as well), and their pixels."""
    objects, areas = _find_visible_objects(photo)
    low, high = np.log(photo.faults.parts_above)
    coarse_from = np.exp(low + (high - low) * photo.draws.draw("coarse parts", objects))
    coarse_from *= 0.8 + 0.4 * photo.draws.draw_once("size here", objects)
    fine_from = coarse_from * (1.7 + 1.3 * photo.draws.draw("fine parts", objects))
    size = np.sqrt(areas) / photo.scale
    return objects, (size > coarse_from).astype(np.int64) + (size > fine_from), areas


def _find_wholes(photo: _Photo) -> dict[int, Bool[ndarray, "h w"]]:
    """Masks of whole objects by instance, joined with the shadow that some vehicles and people cast."""
    objects, levels, _ = _find_levels(photo)
    found = (levels == 0) | (photo.draws.draw("whole", objects, *photo.run) < photo.faults.whole_found)
    wholes = {int(number): photo.units.objects == number for number in objects[found]}
    for number in wholes:
        if photo.families[number] in (VEHICLE, PERSON) and _draw_shadow(photo, number) < _JOINED_SHADOW:
            wholes[number] = wholes[number] | _find_shadow(photo, number)
    return wholes


def _merge_wholes(photo: _Photo, wholes: dict[int, Bool[ndarray, "h w"]]) -> list[_Region]:
    """The masks of whole objects; pairs that touch become one in runs of photos."""
    pairs = _find_touching_pairs(photo.units.objects)
    if len(pairs):
        ever = photo.draws.draw("pair is ever merged", pairs[:, 0], pairs[:, 1]) < _EVER_MERGED
        now = photo.draws.draw("pair is merged", pairs[:, 0], pairs[:, 1], *photo.run)
        pairs = pairs[ever & (now < photo.faults.merged / _EVER_MERGED)]
    root = {number: number for number in wholes}
    for one, other in pairs.tolist():
        if one in root and other in root:
            old, new = root[other], root[one]
            root = {number: new if name == old else name for number, name in root.items()}
    joined: dict[int, Bool[ndarray, "h w"]] = {}
    for number, mask in wholes.items():
        joined[root[number]] = joined[root[number]] | mask if root[number] in joined else mask
    splits = photo.draws.draw("split", np.array(list(joined), np.int64)) < _SPLIT_UNITS
    return [_Region(mask, bool(split)) for mask, split in zip(joined.values(), splits, strict=True)]


def _find_touching_pairs(objects: ndarray) -> Int64[ndarray, "p 2"]:
    """Pairs of objects with a common border, the lower number first."""
    ones = [objects[:, :-1].ravel(), objects[:-1].ravel()]
    others = [objects[:, 1:].ravel(), objects[1:].ravel()]
    pairs = np.stack([np.concatenate(ones), np.concatenate(others)], axis=1).astype(np.int64)
    pairs = np.sort(pairs[(pairs[:, 0] != pairs[:, 1]) & (pairs > 0).all(axis=1)], axis=1)
    return np.unique(pairs, axis=0)


def _find_parts(photo: _Photo) -> Iterator[_Region]:
    """Masks of parts: of objects that are large enough, and found."""
    objects, levels, _ = _find_levels(photo)
    for maps, name, level in ((photo.units.coarse, "coarse part", 1), (photo.units.fine, "fine part", 2)):
        shown = np.zeros(len(photo.families), bool)
        shown[objects[levels >= level]] = True
        places = np.flatnonzero(shown[photo.units.objects.ravel()] & (maps.ravel() > 0))
        keys = np.stack([photo.units.objects.ravel()[places].astype(np.int64), maps.ravel()[places]], axis=1)
        parts, part_of_place = np.unique(keys, axis=0, return_inverse=True)
        found = photo.draws.draw(name, parts[:, 0], parts[:, 1]) < photo.faults.part_found
        splits = photo.draws.draw(f"split {name}", parts[:, 0], parts[:, 1]) < _SPLIT_UNITS
        for number in np.flatnonzero(found):
            mask = np.zeros(photo.units.objects.size, bool)
            mask[places[part_of_place.ravel() == number]] = True
            yield _Region(mask.reshape(photo.units.objects.shape), bool(splits[number]))


def _find_own_shadows(photo: _Photo) -> Iterator[_Region]:
    """Cast shadows that are masks of their own."""
    family = photo.families[photo.units.objects]
    for number in np.unique(photo.units.casters[family == GROUND]).tolist():
        if number == 0:
            continue
        share = _draw_shadow(photo, int(number))
        joins = _JOINED_SHADOW if photo.families[number] in (VEHICLE, PERSON) else 0.0
        if joins <= share < joins + _OWN_SHADOW:
            yield _Region(
                _find_shadow(photo, int(number)), bool(photo.draws.draw("split shadow", number)[0] < _SPLIT_UNITS)
            )


def _draw_shadow(photo: _Photo, number: int) -> float:
    return float(photo.draws.draw("shadow", number)[0])


def _find_shadow(photo: _Photo, number: int) -> Bool[ndarray, "h w"]:
    """Ground in the shadow of an object."""
    return (photo.units.casters == number) & (photo.families[photo.units.objects] == GROUND)


def _ask_grid(region: _Region, scale: float) -> Iterator[Bool[ndarray, "h w"]]:
    """The masks of a region, or of each of its pieces; none where no point of the grid lies in it."""
    pieces = region.mask.astype(np.int32)
    if region.splits:
        ndimage.label(region.mask, output=pieces)
    spacing = max(1, round(GRID * scale))
    asked = np.unique(pieces[spacing // 2 :: spacing, spacing // 2 :: spacing])
    sizes = np.bincount(pieces.ravel())
    for piece in asked[asked > 0]:
        if sizes[piece] >= _SMALLEST * scale**2:
            yield pieces == piece
