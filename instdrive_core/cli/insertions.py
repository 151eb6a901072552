"""Where ``instdrive apply --insert`` puts other scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.queries.coordinates import FARTHEST_MIDDLE, measure_distance, measure_offset
from instdrive_core.formats.registry import open_scene
from instdrive_core.scene.scene import Scene


def build_insertions(document: Document, paths: Sequence[Path], is_turned: bool) -> list[InsertScene]:
    """Build the edits, and say of each scene with an origin whether it is placed by it.

    A scene is placed by its coordinates where it and the document say where in the world their origins are, and else
    by its own numbers, as metres of the document.

    Args:
        document: what they are inserted into.
        paths: of the scenes.
        is_turned: whether the document is turned or scaled before they are inserted.

    Raises DataError, SceneTooLargeError, EditError where one has no splats.
    """
    edits = []
    for path in paths:
        source = (document.open_scene or open_scene)(path)
        if reason := _find_obstacle(document, source, is_turned):
            if source.origin.any() or document.scene.origin.any():
                print(f"{path}: {reason}; its numbers are taken as metres of the scene")
            edits.append(InsertScene.from_scene(source, str(path)))
            continue
        x, y, z = measure_offset(document, source).tolist()
        print(f"{path}: placed where its coordinates have it, {x:.2f}, {y:.2f}, {z:.2f} m from its own numbers")
        edits.append(InsertScene.from_scene(source, str(path), (x, y, z)))
    return edits


def _find_obstacle(document: Document, source: Scene, is_turned: bool) -> str:
    """Why coordinates cannot place a scene; empty where they can."""
    if not source.origin.any():
        return "it says nothing of where its origin is in the world"
    if not document.scene.origin.any():
        return "the scene says nothing of where its origin is in the world"
    if is_turned or not np.array_equal(document.orientation, np.eye(3, 4)):
        return "the scene was turned or scaled, so that its axes are no longer those of the coordinates"
    means = source.gaussians.means[source.nodes == 0]
    middle = np.median(means, axis=0).astype(np.float64) if len(means) else np.zeros(3)
    distance = measure_distance(document, source, middle)
    if not distance <= FARTHEST_MIDDLE:
        return f"by its coordinates it lies {distance / 1000:.1f} km away"
    return ""
