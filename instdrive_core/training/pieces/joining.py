"""The scenes of all pieces as one: ground by territory, movers by track, instances by shared photos, one sky."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.instances.codebook import decode_codewords
from instdrive_core.instances.id_assignment import number_by_size
from instdrive_core.instances.interiors import fill_from_nearest
from instdrive_core.instances.separated_codes import generate_separated_codewords
from instdrive_core.instances.shadows import find_learned_shadows, mark_learned_shadows
from instdrive_core.instances.table import build_instance_table
from instdrive_core.rasterize.sky_evidence import measure_sky_evidence
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.training.instances.naming import make_display_names
from instdrive_core.training.pieces.actors import ActorPart, join_actor
from instdrive_core.training.pieces.colors import align_colors, change_colors, join_exposures
from instdrive_core.training.pieces.cut import list_steps
from instdrive_core.training.pieces.ground import Territories, list_owned_steps, measure_closeness
from instdrive_core.training.pieces.identities import InstanceUnion, count_shared_pixels, match_instances
from instdrive_core.training.pieces.plan import Piece
from instdrive_core.training.pieces.skies import SeenSky, join_skies

CRUMB = 0.1
"""An instance that its neighbour knows nothing of, and that keeps a smaller share of its Gaussians than this, is what
the border left over of something beyond it."""
_FEATURE = 0.5
"""Features are this multiple of the codeword's vector, as in runs of one piece."""


@dataclass
class _Collected:
    """What is kept of the pieces, in their order."""

    backgrounds: list[Gaussians] = field(default_factory=list)
    keys: list[Int64[ndarray, " n"]] = field(default_factory=list)
    """Piece and ID of each kept background Gaussian in one number; -1 = none."""
    actors: dict[str, list[ActorPart]] = field(default_factory=dict)
    skies: list[SeenSky] = field(default_factory=list)
    exposures: list[Exposures | None] = field(default_factory=list)
    views: list[CameraView] = field(default_factory=list)
    """Views of the time steps that belong to one piece, where that piece found their cameras."""
    union: InstanceUnion = field(default_factory=InstanceUnion)
    matched: set[tuple[int, int]] = field(default_factory=set)
    sizes: Counter[tuple[int, int]] = field(default_factory=Counter)
    """Background Gaussians of each instance before the cut."""
    classes: dict[tuple[int, int], tuple[str, int]] = field(default_factory=dict)
    """Class and Gaussians of each instance that has one."""


def join_pieces(
    clip: Clip,
    pieces: Sequence[Piece],
    open_piece: Callable[[int], Scene],
    on_note: Callable[[str], None] = lambda note: None,
) -> Scene:
    """Join the scenes that pieces of a clip were trained to.

    Args:
        clip: the whole drive, with the tracks that pieces were trained with.
        pieces: its pieces.
        open_piece: reads the scene of a piece by its number, in the clip's coordinates; called twice for each, and no
            more than two of them are in memory at a time.
        on_note: is told how many instances go on across a border.
    """
    changes = align_colors([open_piece(number).exposures for number in range(len(pieces))])
    territories, kept = Territories(list_steps(clip), pieces), _Collected()
    before: Scene | None = None
    for number, piece in enumerate(pieces):
        scene = change_colors(open_piece(number), changes[number])
        if before is not None:
            _match_border(kept, number, before, scene, pieces[number - 1].last, on_note)
        _collect(kept, number, scene, territories.choose_background(scene, number), _find_span(clip, piece))
        owned = list_owned_steps(piece)
        kept.views += [view for view in scene.views if view.index in owned]
        before = scene
    return _assemble(clip, pieces, kept, before)


def _match_border(
    kept: _Collected, number: int, before: Scene, scene: Scene, last: int, on_note: Callable[[str], None]
) -> None:
    """Join the instances of the piece before with those of this one."""
    views = [view for view in scene.views if view.index <= last]
    pairs = match_instances(count_shared_pixels(before, scene, views))
    for one, other in pairs:
        kept.union.join([(number - 1, one), (number, other)])
        kept.matched |= {(number - 1, one), (number, other)}
    on_note(f"pieces {number} and {number + 1}: {len(pairs)} standing things and surfaces are in both")


def _collect(
    kept: _Collected, number: int, scene: Scene, chosen: Bool[ndarray, " n"], span: tuple[float, float]
) -> None:
    ids, background = scene.instance_ids.astype(np.int64), scene.nodes == 0
    plain = replace(scene.gaussians, features=np.zeros((len(scene), 0), np.float32))
    kept.backgrounds.append(plain.select(chosen))
    kept.keys.append(np.where(ids[chosen] > 0, _pack((number, 0)) + ids[chosen], -1))
    for instance, count in zip(*np.unique(ids[background], return_counts=True), strict=True):
        kept.sizes[number, int(instance)] += int(count)
    for instance in scene.table:
        if instance.class_name:
            kept.classes[number, instance.id] = instance.class_name, instance.count
    for actor, track in enumerate(scene.actors):
        rows = np.flatnonzero(scene.nodes == actor + 1)
        if len(rows):
            part = ActorPart(number, track, plain.select(rows), ids[rows], measure_closeness(scene, actor), span)
            kept.actors.setdefault(track.id, []).append(part)
    if scene.sky is not None:
        kept.skies.append(SeenSky(scene.sky, measure_sky_evidence(scene, scene.sky.faces.shape[1])))
    kept.exposures.append(scene.exposures)


def _assemble(clip: Clip, pieces: Sequence[Piece], kept: _Collected, last: Scene | None) -> Scene:
    parts, keys = list(kept.backgrounds), _drop_crumbs(np.concatenate(kept.keys), kept)
    actors: list[Track] = []
    nodes, groups = [np.zeros(len(keys), np.uint16)], [keys]
    for track in clip.tracks:
        if track.id not in kept.actors:
            continue
        joined = join_actor(kept.actors[track.id])
        actors.append(joined.track)
        members = list(zip(joined.parts, joined.instances, strict=True))
        kept.union.join(members)
        key = _pack(members[0]) if members else -1
        parts.append(joined.gaussians)
        nodes.append(np.full(len(joined.gaussians), len(actors), np.uint16))
        groups.append(np.full(len(joined.gaussians), key, np.int64))
    gaussians, node_of_row, keys = concatenate_gaussians(parts), np.concatenate(nodes), np.concatenate(groups)
    has_instances = bool((keys >= 0).any())
    keys = _unite(keys, kept.union)
    if has_instances:
        keys = fill_from_nearest(keys, gaussians.means, node_of_row)
    ids = number_by_size(keys)
    codewords, bits, features = _assign_codewords(ids)
    classes = _join_classes(ids, keys, kept)
    times = [frame for frame in clip.frames if not frame.view.held_out]
    owned = [frozenset(frame.key for frame in times if frame.view.index in list_owned_steps(piece)) for piece in pieces]
    names = make_display_names(ids, classes)
    boxes = np.array([track.dimensions for track in actors], np.float64).reshape(-1, 3)
    arrays = gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.sh_dc
    shadows = find_learned_shadows(*arrays, node_of_row, boxes)
    return Scene(
        gaussians=replace(gaussians, features=features),
        instance_ids=ids,
        codewords=codewords,
        nodes=node_of_row,
        table=build_instance_table(ids, gaussians.means, codewords, node_of_row, names, classes, shadows),
        actors=tuple(actors),
        sky=join_skies(kept.skies),
        views=tuple(frame.view for frame in clip.with_cameras(kept.views).frames),
        origin=clip.origin,
        exposures=join_exposures(kept.exposures, owned),
        code_bits=bits,
        extra=mark_learned_shadows(shadows),
        antialiased=last is not None and last.antialiased,
    )


def _drop_crumbs(keys: Int64[ndarray, " n"], kept: _Collected) -> Int64[ndarray, " n"]:
    """Forget the instances of which the cut left next to nothing; their Gaussians follow what is around them."""
    found, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    for place, (key, count) in enumerate(zip(found.tolist(), counts.tolist(), strict=True)):
        instance = _unpack(key)
        if key >= 0 and instance not in kept.matched and count < CRUMB * kept.sizes[instance]:
            found[place] = -1
    return found[inverse]


def _unite(keys: Int64[ndarray, " n"], union: InstanceUnion) -> Int64[ndarray, " n"]:
    found, inverse = np.unique(keys, return_inverse=True)
    roots = [key if key < 0 else _pack(union.find(_unpack(key))) for key in found.tolist()]
    return np.array(roots, np.int64)[inverse]


def _assign_codewords(ids: ndarray) -> tuple[ndarray, int, Float32[ndarray, "n d"]]:
    """A codeword for each instance of the whole scene; without any, zeros."""
    count = int(ids.max(initial=0))
    if not count:
        return np.zeros(len(ids), np.uint32), 0, np.zeros((len(ids), 0), np.float32)
    codes, bits = generate_separated_codewords(count)
    codewords = codes[np.maximum(ids, 1) - 1]
    return codewords, bits, (_FEATURE * decode_codewords(codewords, bits)).astype(np.float32)


def _join_classes(ids: ndarray, keys: Int64[ndarray, " n"], kept: _Collected) -> dict[int, str]:
    """Class of each joined instance: the one that most Gaussians of its parts have."""
    votes: dict[tuple[int, int], Counter[str]] = {}
    for instance, (name, count) in sorted(kept.classes.items()):
        votes.setdefault(kept.union.find(instance), Counter())[name] += count
    found, rows = np.unique(keys, return_index=True)
    pairs = zip(found.tolist(), ids[rows].tolist(), strict=True)
    return {number: votes[root].most_common(1)[0][0] for key, number in pairs if (root := _unpack(key)) in votes}


def _find_span(clip: Clip, piece: Piece) -> tuple[float, float]:
    """Seconds that belong to a piece alone."""
    times: Float64[ndarray, " t"] = np.array(
        [frame.view.time for frame in clip.frames if frame.view.index in list_owned_steps(piece)]
    )
    return float(times.min()), float(times.max())


def _pack(instance: tuple[int, int]) -> int:
    return (instance[0] << 32) + instance[1]


def _unpack(key: int) -> tuple[int, int]:
    return (-1, 0) if key < 0 else (key >> 32, key & 0xFFFFFFFF)
