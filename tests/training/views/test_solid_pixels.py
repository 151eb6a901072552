"""What masks show stands before the sky, unless it may be a cloud."""

from dataclasses import replace

import numpy as np
from drive import drive

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.training.views.solid_pixels import find_solid_pixels
from instdrive_core.training.views.training_view import TrainingView

CAMERA = Camera(50.0, 50.0, 40.0, 30.0, 80, 60, look_at(np.array([0.0, 0.0, 1.5]), np.array([0.0, 20.0, 1.5])))
"""Looks along the ground: row 30 is the horizon."""
LABELS = np.zeros((60, 80), np.uint16)
LABELS[5:15, 10:30] = 1  # above the horizon
LABELS[10:40, 40:60] = 2  # a house
SKY = np.zeros(LABELS.shape, bool)
SKY[:12] = True


def test_masks_are_solid_but_for_their_sky():
    found = find_solid_pixels([LABELS], SKY, CAMERA, knows_sky=True)
    np.testing.assert_array_equal(found, (LABELS > 0) & ~SKY)


def test_each_layer_counts():
    none = np.zeros_like(LABELS)
    for layers in ([none, LABELS], [LABELS, none]):
        np.testing.assert_array_equal(find_solid_pixels(layers, SKY, CAMERA, True), (LABELS > 0) & ~SKY)


def test_what_may_be_a_cloud_is_left_out_where_only_looks_tell_the_sky():
    found = find_solid_pixels([LABELS], SKY, CAMERA, knows_sky=False)
    np.testing.assert_array_equal(found, (LABELS == 2) & ~SKY)


def test_a_view_knows_by_its_lidar_and_spares_the_ego_car():
    frame = drive().training_frames[0]
    valid = np.ones(LABELS.shape, bool)
    valid[30:] = False
    lidar = np.zeros(1, np.int32), np.ones(1, np.float32)
    image = np.zeros((*LABELS.shape, 3), np.uint8)
    view = TrainingView(frame.key, CAMERA, 0.0, image, valid, LABELS, SKY, *lidar)
    np.testing.assert_array_equal(view.solid, (LABELS > 0) & ~SKY & valid)
    blind = replace(view, depth_pixels=lidar[0][:0], depth_values=lidar[1][:0])
    np.testing.assert_array_equal(blind.solid, (LABELS == 2) & ~SKY & valid)
    assert replace(view, labels=None).solid is None
    assert replace(view, sky=None).solid is None
    assert replace(view, sky=np.ones_like(SKY)).solid is None
