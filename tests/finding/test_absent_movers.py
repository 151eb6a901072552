"""What moves in photos and stands in the scene, or is not in it at all, is told apart."""

from dataclasses import replace

import numpy as np
from procedural_street import procedural_street

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.evaluation.metrics.box_pixels import find_moving_box_pixels
from instdrive_core.finding.absent_movers import leave_out_absent_movers
from instdrive_core.rasterize.scene_view import view_scene


def photograph(scene):
    """The front camera's photos of the drive, small."""
    frames = []
    for view in scene.views[::2]:
        camera = view.camera.scale(0.4)
        drawn = view_scene(scene, camera, view.time).color
        photo = (np.clip(drawn, 0, 1) * 255).round().astype(np.uint8)
        frames.append(Frame(replace(view, camera=camera), lambda photo=photo: photo))
    names = ("front_camera",)
    return Clip("street", "street", np.zeros(3), tuple(frames), (), scene.actors, {}, names)


def test_photos_keep_the_car_where_the_scene_has_it_and_lose_it_elsewhere():
    drive = procedural_street(0.25)
    clip = photograph(drive)
    standing = bake_document(Document(procedural_street(0.25)), time=0.0)
    kept, photos = leave_out_absent_movers(standing, clip)
    assert photos == 2  # half a second later, most of the car still covers its place
    assert kept.frames[0].valid is None
    for frame in kept.frames[2:]:
        box = find_moving_box_pixels(frame.view.camera, drive.actors, frame.view.time)
        np.testing.assert_array_equal(frame.valid, ~box)


def test_a_scene_with_tracks_and_a_clip_without_stay_as_they_are():
    drive = procedural_street(1.0)
    clip = photograph(drive)
    assert leave_out_absent_movers(drive, clip) == (clip, 0)
    still = replace(clip, tracks=())
    assert leave_out_absent_movers(bake_document(Document(drive), time=0.0), still) == (still, 0)
