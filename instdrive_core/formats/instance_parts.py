"""A scene in parts, one for each instance and one for the rest, for formats that keep instances as things of a tree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Int64, UInt16, UInt32
from numpy import ndarray

from instdrive_core.instances.table import Instance, InstanceTable, build_instance_table
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene

BACKGROUND = "background"
"""Name of the part whose splats belong to no instance."""
_MOST_IDS = 1 << 24


@dataclass(frozen=True)
class InstancePart:
    """Rows of one instance, in the order of `order_by_instance`."""

    rows: slice
    name: str
    """Different for each part; the instance's name where no other has it."""
    instance: Instance | None
    """None for the background."""

    def describe(self) -> dict[str, Any]:
        """Describe what a format has no place of its own for: ID, class, codeword, name and colour."""
        if self.instance is None:
            return {"id": 0}
        entry = self.instance
        return {
            "id": entry.id,
            "name": entry.name,
            "class": entry.class_name,
            "codeword": entry.codeword,
            "color": list(entry.color),
        }


def order_by_instance(scene: Scene) -> Int64[ndarray, " n"]:
    """Order rows by the ID of their instance; rows of one instance stay in their order."""
    return np.argsort(scene.instance_ids, kind="stable")


def list_instance_parts(scene: Scene) -> Iterator[InstancePart]:
    """List the parts of a scene, the background first; parts without splats are left out."""
    ids, starts = np.unique(np.sort(scene.instance_ids), return_index=True)
    taken = {BACKGROUND}
    for number, start, stop in zip(ids.tolist(), starts, [*starts[1:], len(scene)], strict=True):
        instance = scene.table.instances.get(number)
        name = BACKGROUND if number == 0 else instance.name if instance and instance.name else f"instance {number}"
        while number and name in taken:
            name = f"{name} ({number})"
        taken.add(name)
        if number and instance is None:
            instance = Instance(number, name)
        yield InstancePart(slice(int(start), int(stop)), name, instance)


@dataclass(frozen=True)
class JoinedParts:
    """What a scene is made of."""

    gaussians: Gaussians
    instance_ids: UInt32[ndarray, " n"]
    codewords: UInt32[ndarray, " n"]
    nodes: UInt16[ndarray, " n"]
    table: InstanceTable


@dataclass
class PartCollector:
    """Gathers parts that are read and makes a scene of them."""

    parts: list[Gaussians] = field(default_factory=list)
    ids: list[UInt32[ndarray, " k"]] = field(default_factory=list)
    codewords: list[UInt32[ndarray, " k"]] = field(default_factory=list)
    nodes: list[UInt16[ndarray, " k"]] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)
    classes: dict[int, str] = field(default_factory=dict)

    def add(self, gaussians: Gaussians, description: Mapping[str, Any], node: int = 0) -> None:
        """Add a part of a node and what `InstancePart.describe` said of it; what is not as it should be is passed
        over."""
        number = _get_whole(description.get("id"), _MOST_IDS)
        count = len(gaussians)
        self.parts.append(gaussians)
        self.ids.append(np.full(count, number, np.uint32))
        codeword = _get_whole(description.get("codeword"), 1 << 32) if number else 0
        self.codewords.append(np.full(count, codeword, np.uint32))
        self.nodes.append(np.full(count, node, np.uint16))
        if not number:
            return
        name, class_name = description.get("name"), description.get("class")
        if isinstance(name, str) and name:
            self.names[number] = name
        if isinstance(class_name, str) and class_name:
            self.classes[number] = class_name

    def join(self) -> JoinedParts:
        """Join the parts, at the highest SH degree of any."""
        rest = max(part.sh_rest.shape[1] for part in self.parts)
        for part in self.parts:
            part.sh_rest = np.pad(part.sh_rest, ((0, 0), (0, rest - part.sh_rest.shape[1]), (0, 0)))
        gaussians = concatenate_gaussians(self.parts) if len(self.parts) > 1 else self.parts[0]
        ids, codewords = np.concatenate(self.ids), np.concatenate(self.codewords)
        nodes = np.concatenate(self.nodes)
        table = build_instance_table(ids, gaussians.means, codewords, nodes, self.names, self.classes)
        return JoinedParts(gaussians, ids, codewords, nodes, table)


def _get_whole(value: Any, limit: int) -> int:
    """Return a whole number from 0 to below `limit`; 0 for anything else."""
    fits = isinstance(value, int) and not isinstance(value, bool) and 0 <= value < limit
    return value if fits else 0
