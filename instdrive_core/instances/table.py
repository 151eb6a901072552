"""The table of instances: what is known of each, beside the ID of every Gaussian."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, UInt16, UInt32
from numpy import ndarray

from instdrive_core.instances.colormap import colors_from_ids

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Lower and upper corner of a box, metres."""


@dataclass(frozen=True)
class Instance:
    """One selectable thing: a spatial component of one codeword within one node, but for strays in others."""

    id: int
    """1 … 2^24 - 1; 0 means no instance and is never in the table."""
    name: str
    node: int = 0
    """0 = background, k = actor k - 1 of the scene: the one that most of its Gaussians belong to."""
    codeword: int = 0
    count: int = 0
    """Gaussians that carry the ID."""
    class_name: str = ""
    """Class from the data set or the user; empty where unknown."""
    bounds: Bounds = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    """Lower and upper corner in metres, in the node's own frame, of the box that holds the middle 94 % of the means of
    the node's Gaussians along each axis: strays do not make a car 40 m long."""

    @property
    def color(self) -> tuple[int, int, int]:
        """RGB8 of this ID in the bijective colour map."""
        return _compute_color(self.id)


@lru_cache(1 << 16)
def _compute_color(number: int) -> tuple[int, int, int]:
    """Kept, as each frame of the editor shows some."""
    r, g, b = colors_from_ids(np.array(number, np.uint32))
    return int(r), int(g), int(b)


@dataclass
class InstanceTable:
    """Instances by ID, in ID order."""

    instances: dict[int, Instance] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.instances)

    def __iter__(self) -> Iterator[Instance]:
        return iter(sorted(self.instances.values(), key=lambda instance: instance.id))

    def __contains__(self, instance_id: int) -> bool:
        return instance_id in self.instances

    def __getitem__(self, instance_id: int) -> Instance:
        return self.instances[instance_id]

    def set(self, instance: Instance) -> None:
        """Add or replace an instance."""
        self.instances[instance.id] = instance


def make_default_name(instance_id: int) -> str:
    """Make the name that an instance has before anyone names it."""
    return f"instance {instance_id}"


def build_instance_table(
    instance_ids: UInt32[ndarray, "n"],
    means: Float[ndarray, "n 3"],
    codewords: UInt32[ndarray, "n"] | None = None,
    nodes: UInt16[ndarray, "n"] | None = None,
    names: dict[int, str] | None = None,
    classes: dict[int, str] | None = None,
    shadows: Bool[ndarray, "n"] | None = None,
) -> InstanceTable:
    """Count and bound every ID above 0.

    Codeword and node are the most frequent ones of the ID's Gaussians (the lowest of equals). Its `shadows` lie outside
    of its bounds.
    """
    narrow = np.min_scalar_type(int(instance_ids.max(initial=0)))  # two bytes are sorted by digits, ten times as fast
    narrowed = instance_ids.astype(narrow)
    order = np.argsort(narrowed, kind="stable")
    ids, starts, counts = _find_runs(narrowed[order])
    common = _find_most_frequent(instance_ids, codewords) if codewords is not None else {}
    node_of = find_main_nodes(instance_ids, nodes) if nodes is not None else {}
    table = InstanceTable()
    for instance_id, start, count in zip(ids.tolist(), starts.tolist(), counts.tolist(), strict=True):
        if instance_id == 0:
            continue
        rows, node = order[start : start + count], node_of.get(instance_id, 0)
        own = rows if nodes is None else rows[nodes[rows] == node]
        body = own if shadows is None else own[~shadows[own]]
        table.set(
            Instance(
                id=instance_id,
                name=(names or {}).get(instance_id, make_default_name(instance_id)),
                node=node,
                codeword=common.get(instance_id, 0),
                count=count,
                class_name=(classes or {}).get(instance_id, ""),
                bounds=compute_middle_bounds(means[body if len(body) else own]),
            )
        )
    return table


def _find_runs(rising: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """Find the values of a sorted array, where each begins, and how often it stands there."""
    starts = np.flatnonzero(np.diff(rising, prepend=rising[:1]) != 0)
    starts = np.concatenate([np.zeros(min(len(rising), 1), np.int64), starts])
    return rising[starts], starts, np.diff(starts, append=len(rising))


def compute_middle_bounds(means: Float[ndarray, "n 3"]) -> Bounds:
    """Compute the corners of the box that holds the middle 94 % of at least one mean along each axis."""
    low, high = np.quantile(means, [0.03, 0.97], axis=0, method="nearest").tolist()
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def find_main_nodes(instance_ids: UInt32[ndarray, "n"], nodes: UInt16[ndarray, "n"]) -> dict[int, int]:
    """Find for each ID, 0 included, the node that most of its Gaussians belong to, the lowest of equals."""
    return _find_most_frequent(instance_ids, nodes.astype(np.uint32))


def _find_most_frequent(instance_ids: UInt32[ndarray, "n"], values: UInt32[ndarray, "n"]) -> dict[int, int]:
    """Find the value that most Gaussians of each ID have."""
    if len(values) and values.min() == values.max():  # nearly all scenes: numbering millions of pairs takes a second
        return dict.fromkeys(np.unique(instance_ids).tolist(), int(values[0]))
    packed = (instance_ids.astype(np.uint64) << np.uint64(32)) | values
    pairs, counts = np.unique(packed, return_counts=True)
    ids, found = pairs >> np.uint64(32), pairs & np.uint64(0xFFFFFFFF)
    # Rising counts, then falling values: what a dict keeps is the last, so the most frequent.
    order = np.lexsort((-found.astype(np.int64), counts))
    return dict(zip(ids[order].tolist(), found[order].tolist(), strict=True))
