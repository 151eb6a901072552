"""What an edited scene tells NuRec: which actors go, which look otherwise, and which are new.

NuRec edits actors only: things with a track. What was done to the street and to parked things cannot be handed over,
and is listed instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X
from instdrive_core.formats.nurec.edit_assets import AssetEdits, AssetFacts, Replacement, Size
from instdrive_core.formats.nurec.sequence_tracks import SequenceTracks
from instdrive_core.formats.objects.scene_objects import find_scene_objects
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import transform_gaussians
from instdrive_core.wording import format_count

_FORWARD_X_FROM_BOX = np.c_[BOX_FROM_FORWARD_X.T, np.zeros(3)]
_CLOSE = 1.0
"""Metres between the middles of two tracks of one actor."""
_SAME_PLACE, _SAME_TIME = 1e-6, 1e-9
_STILL_TIMES = np.array([0.0, 1.0])
"""Seconds of a parked thing's track where the drive has no times."""


@dataclass(frozen=True)
class HandOver:
    """Edits of actors, and the objects that they show."""

    edits: AssetEdits
    objects: Mapping[str, Gaussians]
    """By the ID of the asset: x forward, y left, z up, metres, origin in the middle of the box."""
    untold: tuple[str, ...]
    """What NuRec cannot be told, a sentence each."""


def plan_hand_over(before: Scene, after: Scene, known: SequenceTracks | None = None) -> HandOver:
    """Compare a scene with what edits made of it, tracks and all.

    Args:
        before: as it was opened.
        after: with the edits, in the same world.
        known: tracks of NuRec's reconstruction of the same drive. Its actors are found by their ID, else by where they
            are; without it, the scene's own IDs are used and its second 0 is microsecond 0.
    """
    origin = before.origin
    names = {track.id: track.id for track in before.actors} if known is None else _match_tracks(before, known)
    start = 0 if known is None else known.start
    old = {track.id: (node, track) for node, track in enumerate(before.actors, 1) if (before.nodes == node).any()}
    taken = {*names.values(), *(track.id for track in known.tracks)} if known else set(names.values())
    removed: list[str] = []
    replaced: list[Replacement] = []
    inserted: list[tuple[str, Track]] = []
    assets: list[AssetFacts] = []
    objects: dict[str, Gaussians] = {}
    untold: list[str] = []
    still = {track.id: (node, track) for node, track in enumerate(after.actors, 1) if (after.nodes == node).any()}
    for name, (node, track) in old.items():
        if name not in names:
            if name not in still or _is_changed(before, node, track, after, *still[name]):
                untold.append(f"the edits of {track.label} {name!r}, as NuRec has no such track")
        elif name not in still or _has_moved(track, still[name][1]):
            removed.append(names[name])
        elif _is_changed(before, node, track, after, *still[name]):
            new_node, new_track = still[name]
            asset = _name_asset(name, objects)
            objects[asset] = _take_object(after, np.flatnonzero(after.nodes == new_node))
            assets.append(AssetFacts(asset, track.label, _measure(new_track)))
            replaced.append(Replacement(names[name], asset, _measure(new_track)))
    for name, (node, track) in still.items():
        if name in old and (name not in names or not _has_moved(old[name][1], track)):
            continue
        asset = _name_asset(name, objects)
        objects[asset] = _take_object(after, np.flatnonzero(after.nodes == node))
        assets.append(AssetFacts(asset, track.label, _measure(track)))
        inserted.append((asset, _place(track, _name_track(name, taken), origin, moving=True)))
    for name, rows, track in _list_new_parked(before, after, known):
        asset = _name_asset(name, objects)
        objects[asset] = _take_parked(after, rows, track)
        assets.append(AssetFacts(asset, track.label, _measure(track)))
        inserted.append((asset, _place(track, _name_track(name, taken), origin, moving=False)))
    untold += _list_untold(before, after)
    return HandOver(
        AssetEdits(tuple(removed), tuple(replaced), tuple(inserted), tuple(assets), start), objects, tuple(untold)
    )


def _match_tracks(scene: Scene, known: SequenceTracks) -> dict[str, str]:
    """NuRec's ID of each actor that it has: the same ID, else the nearest middle within a metre."""
    listed = {track.id: track for track in known.tracks}
    found = {track.id: track.id for track in scene.actors if track.id in listed}
    free = [track for track in known.tracks if track.id not in found]
    pairs = sorted(
        (distance, actor.id, other.id)
        for actor in scene.actors
        if actor.id not in found
        for other in free
        if (distance := _measure_distance(actor, other, scene.origin)) < _CLOSE
    )
    for _, mine, theirs in pairs:
        if mine not in found and theirs not in found.values():
            found[mine] = theirs
    return found


def _measure_distance(mine: Track, theirs: Track, origin: ndarray) -> float:
    """Median metres between two tracks while both last; infinite where they never meet."""
    times = mine.times[(mine.times >= theirs.times[0] - 0.06) & (mine.times <= theirs.times[-1] + 0.06)]
    if not len(times):
        return np.inf
    places = mine.interpolate_poses(times)[:, :3, 3] - theirs.interpolate_poses(times)[:, :3, 3]
    return float(np.median(np.linalg.norm(places + origin, axis=1)))


def _has_moved(one: Track, other: Track) -> bool:
    if one.times.shape != other.times.shape or np.abs(one.times - other.times).max() > _SAME_TIME:
        return True
    return bool(np.abs(one.world_from_box - other.world_from_box).max() > _SAME_PLACE)


def _is_changed(before: Scene, node: int, track: Track, after: Scene, new_node: int, new_track: Track) -> bool:
    """Whether an actor looks otherwise than before, or drives otherwise."""
    one, other = before.gaussians.select(before.nodes == node), after.gaussians.select(after.nodes == new_node)
    return _has_moved(track, new_track) or not _are_equal(one, other)


def _are_equal(one: Gaussians, other: Gaussians) -> bool:
    arrays, others = one.arrays(), other.arrays()
    return all(np.array_equal(arrays[name], others[name], equal_nan=True) for name in arrays if name != "features")


def _take_object(scene: Scene, rows: Int64[ndarray, " k"]) -> Gaussians:
    taken = scene.gaussians.select(rows)
    transform_gaussians(taken, _FORWARD_X_FROM_BOX)
    return taken


def _take_parked(scene: Scene, rows: Int64[ndarray, " k"], track: Track) -> Gaussians:
    taken = scene.gaussians.select(rows)
    transform_gaussians(taken, np.linalg.inv(track.world_from_box[0])[:3])
    transform_gaussians(taken, _FORWARD_X_FROM_BOX)
    return taken


def _list_new_parked(
    before: Scene, after: Scene, known: SequenceTracks | None
) -> Iterator[tuple[str, Int64[ndarray, " k"], Track]]:
    """Still instances that were not there before, each with a track on which it stands."""
    times = [track.times for track in (*before.actors, *(known.tracks if known else ()))]
    span = np.array([min(t[0] for t in times), max(t[-1] for t in times)]) if times else _STILL_TIMES
    span = span if span[1] > span[0] else span[0] + _STILL_TIMES
    for found in find_scene_objects(after, float(span[0])):
        if found.track is not None or found.instance.id in before.table or found.instance.class_name == "synthetic":
            continue
        rows = np.flatnonzero((after.instance_ids == found.instance.id) & (after.nodes == 0))
        pose = np.eye(4)
        pose[:3, :3] = found.box.rotation @ BOX_FROM_FORWARD_X.T
        pose[:3, 3] = found.box.center
        size = np.abs(BOX_FROM_FORWARD_X) @ found.box.size
        name = f"parked_{found.instance.id}"
        label = found.instance.class_name or "object"
        yield name, rows, Track(name, label, size, span, np.stack([pose, pose]))


def _place(track: Track, name: str, origin: ndarray, moving: bool) -> Track:
    """The track in the world, with the name that NuRec gets."""
    poses = track.world_from_box.copy()
    poses[:, :3, 3] += origin
    return replace(track, id=name, world_from_box=poses, moving=moving)


def _measure(track: Track) -> Size:
    width, length, height = track.dimensions.tolist()
    return length, width, height


def _name_asset(name: str, objects: Mapping[str, Gaussians]) -> str:
    """A name that is a folder's, too."""
    base = chosen = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:80] or "object"
    number = 2
    while chosen in objects:
        chosen, number = f"{base}_{number}", number + 1
    return chosen


def _name_track(name: str, taken: set[str]) -> str:
    base = chosen = f"{name}_edited"
    number = 2
    while chosen in taken:
        chosen, number = f"{base}_{number}", number + 1
    taken.add(chosen)
    return chosen


def _list_untold(before: Scene, after: Scene) -> Sequence[str]:
    """What was done to the street and to what stands on it."""
    changed, gone = [], []
    for instance in before.table:
        old = np.flatnonzero((before.instance_ids == instance.id) & (before.nodes == 0))
        if not len(old):
            continue
        new = np.flatnonzero((after.instance_ids == instance.id) & (after.nodes == 0))
        if not len(new):
            gone.append(instance.name)
        elif not _are_equal(before.gaussians.select(old), after.gaussians.select(new)):
            changed.append(instance.name)
    found = []
    for names, what in ((gone, "deleted"), (changed, "changed")):
        if names:
            more = f" and {len(names) - 5} more" if len(names) > 5 else ""
            found.append(f"{format_count(len(names), 'still thing')} {what} ({', '.join(names[:5])}{more})")
    return found
