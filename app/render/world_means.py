"""World positions of a document's splats, kept up to date by placing only those that moved."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.rasterize.edited_rows import RowFrames, write_world_means
from instdrive_core.scene.camera import PhotoLag


class WorldMeans:
    """World positions at the time of the last `update`, and the frames that they are computed from."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._moves, self._new = document.transforms.create_dirty_reader(), document.new_rows.create_reader()
        self._key: tuple[Any, ...] | None = None
        self._driving = (0, 0)
        self._buffer = np.zeros((0, 3), np.float32)
        self.values: Float32[ndarray, "n 3"] = self._buffer
        """Metres. Rows are written in place; adding or removing splats gives another array."""
        self.poses: Float64[ndarray, "m 4 4"] = np.eye(4)[None]
        """world_from_node."""
        self.present: UInt8[ndarray, " m"] = np.ones(1, np.uint8)
        self.frames = RowFrames.copy_from(document.transforms, self.poses)

    def update(self, time: float, lag: PhotoLag | None = None) -> tuple[int, int] | None:
        """Bring everything to the document's present state at `time` (seconds), as a photo with this `lag` shows it.

        Returns the range of rows that may have moved or are new, or None. Rows that are gone are in no range.
        """
        document, scene = self._document, self._document.scene
        ranges = [self._moves.take(), self._take_new_rows()]
        key = (time, lag, document.versions.tracks)
        if key != self._key:
            poses, self.present = scene.find_node_poses(time, lag)
            if not np.array_equal(poses, self.poses):
                ranges.append(self._driving)
            self.poses, self._key = poses, key
        touched = [(start, stop) for start, stop in filter(None, ranges) if start < stop]
        if not touched:
            return None
        rows = min(start for start, _ in touched), max(stop for _, stop in touched)
        self.frames = RowFrames.copy_from(document.transforms, self.poses)
        write_world_means(
            scene.gaussians.means, document.transforms.indices, scene.nodes, self.frames, rows, self.values
        )
        return rows

    def _take_new_rows(self) -> tuple[int, int] | None:
        nodes, rows = self._document.scene.nodes, self._new.take()
        count = len(nodes)
        if count > len(self._buffer):
            # Room for more rows, as the document's own arrays have.
            grown = np.empty((count + count // 8, 3), np.float32)
            grown[: len(self.values)] = self.values
            self._buffer = grown
        if rows is not None or count != len(self.values):
            driving = np.flatnonzero(nodes)
            self._driving = (int(driving[0]), int(driving[-1]) + 1) if len(driving) else (0, 0)
            self.values = self._buffer[:count]
        return rows
