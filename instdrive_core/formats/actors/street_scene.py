"""StreetGaussians' background and objects as one scene: each object an instance, in its track's box if it has one.

An object's Gaussians are in the box's axes (x forward, y left, z up) around its middle, their colours above the
constant SH in the world's. The constant colour is a short Fourier series over the object's frames (Yan et al. 2024,
``lib/utils/sh_utils.py``). Objects without a track lie in a row above the street.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X, turn_into_box
from instdrive_core.formats.actors.moments import find_shown_row
from instdrive_core.formats.actors.row import lay_into_row
from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track

STREET_BACKGROUND, STREET_SKY = "background", "sky"
_UP = np.array([0.0, 0.0, 1.0])


def sort_street_parts(names: Sequence[str], tracks: Mapping[str, Track]) -> list[str]:
    """Sort parts into the order of a scene's rows: background, sky, objects without a track, objects with one."""
    first = {STREET_BACKGROUND: 0, STREET_SKY: 1}
    return sorted(names, key=lambda name: (first.get(name, 2), name in tracks))


def weigh_waves(track: Track | None, time: float | None, count: int) -> Float64[ndarray, " {count}"]:
    """Weigh the coefficients of a colour over time: cosines at even places, sines at odd ones.

    The moment is that of the track nearest to `time` (s), the middle of it if that is None, and half-way through
    without a track.
    """
    share = 0.5
    if track is not None:
        moment = find_shown_row(track, time)
        share = float(track.times[moment] - track.times[0]) / max(float(track.times[-1] - track.times[0]), 1e-9)
    steps = np.arange(count)
    return np.where(steps % 2, np.sin(np.pi * share * (steps + 1)), np.cos(np.pi * share * steps))


def assemble_street(
    gaussians: Gaussians,
    rows: Mapping[str, slice],
    tracks: Mapping[str, Track],
    time: float | None,
    sky: Sky | None,
    left_out: Sequence[str],
) -> Scene:
    """Put each object's Gaussians, in place, into its box or into the row above the street, and name it.

    Args:
        gaussians: as the trainer holds them, in the order of `sort_street_parts`.
        rows: of each part.
        tracks: of the objects that have one.
        time: seconds into the drive at which colours shall be right; None takes the middle of each track.
        sky: drawn behind them.
        left_out: what the scene does not hold, in sentences.
    """
    ids, nodes = np.zeros(len(gaussians), np.uint32), np.zeros(len(gaussians), np.uint16)
    titles, labels, actors = {}, {}, []
    place = 0.0
    for instance, (name, part) in enumerate(((n, r) for n, r in rows.items() if n != STREET_BACKGROUND), start=1):
        view = gaussians.select(part)
        ids[part], titles[instance] = instance, name
        if name in tracks:
            track = tracks[name]
            actors.append(track)
            nodes[part], labels[instance] = len(actors), track.label
            pose = track.world_from_box[find_shown_row(track, time)].copy()
            pose[:3, :3] = pose[:3, :3] @ BOX_FROM_FORWARD_X
            turn_into_box(view, pose, BOX_FROM_FORWARD_X, np.zeros(3))
        elif name == STREET_SKY:
            labels[instance] = STREET_SKY
        else:
            place = lay_into_row(view, place, _UP)
    return Scene(
        gaussians=gaussians,
        instance_ids=ids,
        codewords=np.zeros(len(gaussians), np.uint32),
        nodes=nodes,
        table=build_instance_table(ids, gaussians.means, None, nodes, titles, labels),
        actors=tuple(actors),
        sky=sky,
        left_out=tuple(left_out),
    )
