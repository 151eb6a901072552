"""Poses of moving objects over time, with learnable corrections of their cuboid tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray
from torch import Tensor

from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.track import Track

_SKEW = torch.tensor(
    [[[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], [[0, -1, 0], [1, 0, 0], [0, 0, 0]]],
    dtype=torch.float64,
).reshape(3, 9)


@dataclass(frozen=True)
class NodePoses:
    """The nodes of a scene at one time: node 0 is the world, node k the k-th actor. Absent actors have the identity."""

    rotations: Float[Tensor, "m 3 3"]
    """world_from_node; the gradient reaches the corrections it was made with."""
    shifts: Float[Tensor, "m 3"]
    """Metres; likewise."""
    present: Bool[ndarray, " m"]
    """Which nodes exist at this time."""
    matrices: Float64[ndarray, "m 4 4"]
    """world_from_node as arrays, without gradient."""


@dataclass(frozen=True)
class _Between:
    """Places of p times between the learned keys of tracks."""

    before: Int[Tensor, " p"]
    """Row in the corrections of the last key before the time, or of the first key."""
    after: Int[Tensor, " p"]
    fraction: Float[Tensor, "p 1"]
    """How far the time is from `before` to `after`."""

    def interpolate(self, values: Float[Tensor, "k 6"]) -> Float[Tensor, "p 6"]:
        """Interpolate the corrections of keys at the times, in float64."""
        start, end = values.index_select(0, self.before).double(), values.index_select(0, self.after).double()
        return torch.lerp(start, end, self.fraction)


@dataclass(frozen=True)
class _Moment:
    """Poses at one time, kept by `ActorPoses`; p actors are present."""

    plain: NodePoses
    nodes: Int[Tensor, " p"]
    rotations: Float[Tensor, "p 3 3"]
    shifts: Float[Tensor, "p 3"]
    between: _Between


class ActorPoses:
    """Poses of actors over time: their tracks, plus a correction of each key that a trainer may learn.

    A correction is a shift (metres) and a turn (rotation vector, radians), both in the box frame, so that the pose is
    R = R_track · exp(turn), t = t_track + R_track · shift; between keys both are interpolated linearly, before the
    first and after the last they stand still. K counts the keys of all tracks, track by track.

    Equal corrections of all keys of one actor only move its Gaussians inside its box; the Gaussians can undo that, so
    this freedom is harmless.

    Poses lie on the corrections' device; they are computed on the CPU, where these few numbers are quickest.

    Keys that belong to no photo, as those of held-out time steps, cannot be learned: left uncorrected between corrected
    neighbours they would make actors jump. They are passed over, so that corrections are interpolated across them.

    Args:
        tracks: the actors, in the order of their nodes.
        photo_times: of the photos to learn from, seconds; a key is learned where it is the nearest to one of them. All
            are where this is left out, or where no photo falls into a track.
    """

    def __init__(self, tracks: tuple[Track, ...], photo_times: Sequence[float] | None = None) -> None:
        self.tracks = tracks
        counts = [len(track.times) for track in tracks]
        self._starts = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
        """Row of each track's first key; at the end K."""
        self._learned = [_find_learned_keys(track, photo_times) for track in tracks]
        """Keys of each track that have a correction of their own."""
        self._moments: dict[tuple[float, PhotoLag | None], _Moment] = {}

    @property
    def key_count(self) -> int:
        """K: key poses of all tracks."""
        return int(self._starts[-1])

    def initial_corrections(self) -> dict[str, Float[Tensor, "k 3"]]:
        """Make corrections that change nothing: zero `track_shifts` and `track_turns`, (K, 3) each."""
        return {name: torch.zeros(self.key_count, 3) for name in ("track_shifts", "track_turns")}

    def at(
        self,
        time: float,
        corrections: Mapping[str, Float[Tensor, "k 3"]] | None = None,
        lag: PhotoLag | None = None,
    ) -> NodePoses:
        """Compute the poses of all nodes at `time` (seconds), as a photo with this `lag` shows them.

        Without corrections the tracks give them.
        """
        if (time, lag) not in self._moments:
            self._moments[time, lag] = self._find_moment(time, lag)
        moment = self._moments[time, lag]
        if corrections is None:
            return moment.plain
        rotations, shifts = _correct(moment.rotations, moment.shifts, moment.between.interpolate(_on_cpu(corrections)))
        device, count = corrections["track_shifts"].device, len(self.tracks) + 1
        matrices = moment.plain.matrices.copy()
        nodes = moment.nodes.numpy()
        matrices[nodes, :3, :3] = rotations.detach().numpy()
        matrices[nodes, :3, 3] = shifts.detach().numpy()
        return NodePoses(
            rotations=torch.eye(3).repeat(count, 1, 1).index_copy(0, moment.nodes, rotations.float()).to(device),
            shifts=torch.zeros(count, 3).index_copy(0, moment.nodes, shifts.float()).to(device),
            present=moment.plain.present,
            matrices=matrices,
        )

    def correct_tracks(self, corrections: Mapping[str, Float[Tensor, "k 3"]]) -> tuple[Track, ...]:
        """Copy the tracks with corrected keys.

        `Track.interpolate_pose` gives the pose of `at` at key times; between them it interpolates corrected poses
        instead of correcting interpolated ones, which differs by products of correction and motion only.
        """
        if not self.tracks:
            return ()
        poses = np.concatenate([track.world_from_box for track in self.tracks])
        rotations, shifts = torch.from_numpy(poses[:, :3, :3].copy()), torch.from_numpy(poses[:, :3, 3].copy())
        between = _join_places([self._between(node, track.times) for node, track in enumerate(self.tracks, start=1)])
        rotations, shifts = _correct(rotations, shifts, between.interpolate(_on_cpu(corrections).detach()))
        poses[:, :3, :3], poses[:, :3, 3] = rotations.numpy(), shifts.numpy()
        parts = np.split(poses, self._starts[1:-1])
        return tuple(replace(track, world_from_box=part) for track, part in zip(self.tracks, parts, strict=True))

    def _find_moment(self, time: float, lag: PhotoLag | None) -> _Moment:
        present = np.array([True, *(track.covers(time) for track in self.tracks)])
        nodes = np.flatnonzero(present[1:]) + 1
        matrices = np.tile(np.eye(4), (len(present), 1, 1))
        shown = {node: self.tracks[node - 1].find_shown_time(time, lag) for node in nodes.tolist()}
        for node in shown:
            matrices[node] = self.tracks[node - 1].interpolate_pose(time, lag)
        rotations, shifts = torch.from_numpy(matrices[:, :3, :3].copy()), torch.from_numpy(matrices[:, :3, 3].copy())
        index = torch.from_numpy(nodes)
        return _Moment(
            plain=NodePoses(rotations.float(), shifts.float(), present, matrices),
            nodes=index,
            rotations=rotations[index],
            shifts=shifts[index],
            between=_join_places([self._between(node, np.array([moment])) for node, moment in shown.items()]),
        )

    def _between(self, node: int, times: Float64[ndarray, " p"]) -> tuple[ndarray, ndarray, ndarray]:
        """Rows before and after each time, and how far it is from one to the other; clamped at the ends."""
        learned = self._learned[node - 1]
        keys = self.tracks[node - 1].times[learned]
        upper = np.searchsorted(keys, times)
        before, after = np.clip(upper - 1, 0, len(keys) - 1), np.clip(upper, 0, len(keys) - 1)
        spans = keys[after] - keys[before]
        fractions = np.where(spans > 0, (times - keys[before]) / np.where(spans > 0, spans, 1), 0)
        return self._starts[node - 1] + learned[before], self._starts[node - 1] + learned[after], fractions


def rotations_from_vectors(vectors: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3 3"]:
    """exp of rotation vectors in float64 (Rodrigues), differentiable at zero too."""
    vectors = vectors.double()
    squares = vectors.square().sum(dim=1)[:, None, None]
    angles = (squares + 1e-24).sqrt()  # the root alone has no gradient at zero
    sine = angles.sin() / angles
    cosine = 0.5 * ((angles / 2).sin() / (angles / 2)).square()  # (1 - cos) / angle², without cancellation
    outer = vectors[:, :, None] * vectors[:, None, :]
    return (1 - cosine * squares) * torch.eye(3) + sine * (vectors @ _SKEW).view(-1, 3, 3) + cosine * outer


def _correct(
    rotations: Float[Tensor, "n 3 3"], places: Float[Tensor, "n 3"], values: Float[Tensor, "n 6"]
) -> tuple[Float[Tensor, "n 3 3"], Float[Tensor, "n 3"]]:
    shifts, turns = values[:, :3], values[:, 3:]
    return rotations @ rotations_from_vectors(turns), places + (rotations @ shifts[:, :, None])[:, :, 0]


def _on_cpu(corrections: Mapping[str, Float[Tensor, "k 3"]]) -> Float[Tensor, "k 6"]:
    """Shift and turn of each key in a row."""
    return torch.cat([corrections["track_shifts"], corrections["track_turns"]], dim=1).cpu()


def _join_places(parts: list[tuple[ndarray, ndarray, ndarray]]) -> _Between:
    empty = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    before, after, fractions = (np.concatenate(column) for column in zip(empty, *parts, strict=True))
    return _Between(torch.from_numpy(before), torch.from_numpy(after), torch.from_numpy(fractions)[:, None])


def _find_learned_keys(track: Track, photo_times: Sequence[float] | None) -> Int[ndarray, " l"]:
    """Find the keys nearest to a photo taken while the track exists; all keys where there is no such photo."""
    times = np.unique([time for time in photo_times or () if track.covers(time)])
    if not len(times):
        return np.arange(len(track.times))
    return np.unique(np.argmin(np.abs(track.times[:, None] - times), axis=0))
