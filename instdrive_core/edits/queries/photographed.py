"""A document as its photos were taken: no edit of a drive, nothing deleted, nothing added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import find_learned
from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.rasterize.preview import Preview, render_preview
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, place_in_world

COVER = 0.5
"""Share of a pixel's light from which something is seen there."""


def restore_drives(document: Document) -> Scene:
    """The scene with all tracks as they were before any edit."""
    tracks = tuple(document.get_first_track(place + 1) for place in range(len(document.scene.actors)))
    return replace(document.scene, actors=tracks)


def draw_photographed(scene: Scene, shapes: Gaussians, view: CameraView, camera: Camera) -> Preview:
    """Draw what a photo showed, without colours: of `shapes`, which are the scene's, those that were trained.

    `camera` is the photo's, or of a part of it.
    """
    poses, present = scene.find_node_poses(view.time, view.camera.lag)
    means, quats = place_in_world(shapes.means, shapes.quats, scene.nodes, poses)
    opacities = np.where(find_learned(scene) & present[scene.nodes], sigmoid(shapes.opacity_logits), np.float32(0))
    parts = (means, quats, shapes.log_scales, opacities, np.zeros((len(scene), 3), np.float32))
    return render_preview(*parts, camera, choose_raster_settings(scene), instances=scene.instance_ids)


def read_depths(shown: Preview) -> Float32[ndarray, "h w"]:
    """Metres along the viewing axis to what is seen; infinite where nothing is."""
    return np.where(shown.alpha >= COVER, shown.depth, np.float32(np.inf))
