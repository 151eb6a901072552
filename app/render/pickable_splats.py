"""What picking needs of every splat, updated only where something has changed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int, Int32
from numpy import ndarray

from instdrive_app.render.world_means import WorldMeans
from instdrive_core.edits.document.document import Document
from instdrive_core.instances.shadows import name_splats
from instdrive_core.rasterize.edited_rows import compute_world_shapes, write_largest_log_scales, write_shown_opacities
from instdrive_core.rasterize.preview.splats import NO_NAMES
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.selection import Flag

_NOT_SHOWN = int(Flag.HIDDEN | Flag.DELETED)


class PickableSplats:
    """Positions, sizes and opacities of all splats at the time of the last `update`; shapes of some rows on demand.

    It has change readers of its own, so that views can follow the same document.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self._world = WorldMeans(document)
        self._dirty_states, self._dirty_colors = (
            document.state.create_dirty_reader(),
            document.colors.create_dirty_reader(),
        )
        self._new = document.new_rows.create_reader()
        self._present: ndarray | None = None
        self.log_sizes: Float32[ndarray, "n 1"] = np.zeros((0, 1), np.float32)
        """Natural logarithm of the longest axis in metres."""
        self.opacities: Float32[ndarray, " n"] = np.zeros(0, np.float32)
        """Opacities after recolouring; 0 for a splat that is hidden or deleted, or whose actor is absent."""
        self.names: Int32[ndarray, " k"] = NO_NAMES
        """What a pixel of each splat stands for (`name_splats`)."""
        self._named_rows = -1

    @property
    def means(self) -> Float32[ndarray, "n 3"]:
        """World positions, metres."""
        return self._world.values

    def update(self, time: float, lag: PhotoLag | None = None) -> None:
        """Bring everything to the document's present state at `time` (seconds), as a photo with this `lag` shows it."""
        document, scene = self.document, self.document.scene
        count = len(scene)
        if count != len(self.opacities):
            self.opacities, self.log_sizes = _resize(self.opacities, count), _resize(self.log_sizes, count)
        if self._named_rows != document.versions.rows:
            self.names, self._named_rows = name_splats(scene.extra), document.versions.rows
        moved = self._world.update(time, lag)
        if moved is not None:
            entries, frames = document.transforms.indices, self._world.frames
            write_largest_log_scales(scene.gaussians.log_scales, entries, frames, moved, self.log_sizes)
        changed = [self._dirty_states.take(), self._dirty_colors.take(), self._new.take()]
        if self._present is None or not np.array_equal(self._present, self._world.present):
            changed.append((0, count))
        self._present = self._world.present
        ranges = [rows for rows in changed if rows is not None]
        if ranges:
            rows = min(start for start, _ in ranges), max(stop for _, stop in ranges)
            logits, flags = scene.gaussians.opacity_logits, document.state.flags
            looks = (logits, document.colors, flags, _NOT_SHOWN)
            write_shown_opacities(*looks, scene.nodes, self._present, rows, self.opacities)

    def compute_shapes(self, rows: Int[ndarray, " k"]) -> tuple[Float32[ndarray, "k 4"], Float32[ndarray, "k 3"]]:
        """Compute quaternions and log scales (metres) of some rows in the world."""
        document = self.document
        return compute_world_shapes(
            document.scene.gaussians, document.transforms.indices, document.scene.nodes, self._world.frames, rows
        )


def _resize(array: ndarray, count: int) -> ndarray:
    resized = np.zeros((count, *array.shape[1:]), array.dtype)
    shared = min(count, len(array))
    resized[:shared] = array[:shared]
    return resized
