"""Letting something that stands still drive."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.edits.bases.append import Addition, AppendEdit, make_unique_track_id
from instdrive_core.edits.bases.driven_track import Keys, build_path_keys, check_keys, drive_along, find_drive_times
from instdrive_core.edits.bases.editable import find_editable_parts
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import create_instances, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.placement import find_solid
from instdrive_core.errors import EditError
from instdrive_core.instances.oriented_box import find_main_parts, fit_upright_box
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import bake_transforms, transform_gaussians
from instdrive_core.scene.vehicle_path import sample_path
from instdrive_core.wording import phrase


@dataclass
class StartDriving(AppendEdit):
    """A copy of a still instance that drives a way, with an ID of its own; the still one stays until it is deleted.

    Which end is its front follows from where the way begins to lead.
    """

    kind: ClassVar[str] = "start_driving"
    id: int
    keys: Keys
    """(time, x, y) or (time, x, y, heading) each: seconds, metres in the scene, radians; times rise."""

    def __post_init__(self) -> None:
        (self.id,) = check_ids((self.id,))
        self.keys = check_keys(self.keys)

    @property
    def title(self) -> str:
        """``Let instance 17 drive``."""
        return phrase("Let instance {id} drive", id=self.id)

    @property
    def shift(self) -> Vector:
        """Nothing is shifted: the track says where it is."""
        return (0.0, 0.0, 0.0)

    def build_addition(self, document: Document) -> Addition:
        """The rows that are neither deleted nor locked, in the axes of their box."""
        scene, entry = document.scene, get_instance(document, self.id)
        if entry.node:
            raise EditError(phrase("instance {id} drives already; give it another way instead", id=self.id))
        rows = find_editable_parts(document, (self.id,)).rows
        part = scene.gaussians.select(rows)
        bake_transforms(part, document.transforms, document.transforms.indices[rows])
        pose, size = self._find_box(document, part)
        transform_gaussians(part, np.linalg.inv(pose)[:3])
        (copy,) = create_instances(document, [entry])
        node = len(scene.actors) + 1
        name = make_unique_track_id(f"instance {self.id}", {track.id for track in scene.actors})
        blank = Track(name, entry.class_name or "object", size, np.zeros(1), pose[None], True)
        track = drive_along(document, (self.id,), self.keys, pose, float(size[2]), blank)
        added = Scene(
            part,
            np.full(len(rows), copy.id, np.uint32),
            scene.codewords[rows],
            np.full(len(rows), node, np.uint16),
            actors=(*scene.actors, track),
            extra={column: values[rows] for column, values in scene.extra.items()},
        )
        still = np.zeros(len(rows), np.uint16)
        return Addition(added, document.colors.indices[rows], still, (replace(copy, node=node),), (track,))

    def _find_box(self, document: Document, part: Gaussians) -> tuple[Float64[ndarray, "4 4"], Float64[ndarray, "3"]]:
        """Pose of the box around the instance, y along the longer side towards which the way leads, and its size."""
        solid = np.flatnonzero(find_solid(sigmoid(part.opacity_logits)) & np.isfinite(part.means).all(axis=1))
        if not len(solid):
            raise EditError(phrase("instance {id} has no splat whose place is a number", id=self.id))
        shaping = solid[find_main_parts(part.means[solid].astype(np.float64))]
        axes = matrix_from_quaternion(normalize_quaternions(part.quats[shaping].astype(np.float64)))
        axes *= np.exp(part.log_scales[shaping].astype(np.float64))[:, None]
        box = fit_upright_box(part.means[shaping].astype(np.float64), axes @ axes.swapaxes(1, 2))
        times = find_drive_times(document, self.keys)
        wanted = sample_path(build_path_keys(self.keys), times, box.yaw).headings[0]
        forward = box.yaw if math.cos(wanted - box.yaw) >= 0 else box.yaw + math.pi
        pose = np.eye(4)
        pose[:2, 0], pose[:2, 1] = (math.sin(forward), -math.cos(forward)), (math.cos(forward), math.sin(forward))
        pose[:3, 3] = box.center
        return pose, box.size[[1, 0, 2]]
