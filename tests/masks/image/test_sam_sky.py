"""Which of the masks is the sky."""

from dataclasses import replace

import numpy as np
from painted_street import ROAD, SKY, painted_clip, truth

from instdrive_core.masks.image.sky_finder import SkyFinder, find_sky_by_looks


def test_the_sky_is_the_mask_that_lidar_looks_through():
    clip = painted_clip("nowhere")
    frame, sky = clip.frames[0], truth(clip.frames[0].view.time) == SKY
    labels = np.where(sky, 1, 2).astype(np.uint32)
    found = SkyFinder(clip).find(frame.load_image(), frame.view.camera, labels)
    np.testing.assert_array_equal(found, sky)
    unlabelled = SkyFinder(clip).find(frame.load_image(), frame.view.camera, np.zeros_like(labels))
    assert (unlabelled & ~sky).sum() == 0
    assert unlabelled.sum() > 0.7 * sky.sum(), "what no mask claims is found too"


def test_without_lidar_the_sky_is_what_looks_and_lies_like_it():
    clip = replace(painted_clip("nowhere"), sweeps=())
    frame, classes = clip.frames[0], truth(clip.frames[0].view.time)
    found = SkyFinder(clip).find(frame.load_image(), frame.view.camera, (classes + 1).astype(np.uint32))
    np.testing.assert_array_equal(found, classes == SKY)
    labels = np.ones_like(classes, np.uint32)
    assert not find_sky_by_looks(frame.load_image(), frame.view.camera, labels).any(), "reaches below the horizon"
    dark = (frame.load_image() // 4).astype(np.uint8)
    dark[classes == ROAD] = 200
    assert not find_sky_by_looks(dark, frame.view.camera, (classes + 1).astype(np.uint32)).any(), "darker than the road"


def test_a_sky_between_branches_is_smooth_where_it_is_wide():
    clip = replace(painted_clip("nowhere"), sweeps=())
    frame, classes = clip.frames[0], truth(clip.frames[0].view.time)
    image, labels = frame.load_image(), (classes + 1).astype(np.uint32)
    for row in range(2, 30, 4):
        image[row], labels[row] = 20, 99
    found = find_sky_by_looks(image, frame.view.camera, labels)
    np.testing.assert_array_equal(found, labels == SKY + 1)
    noisy = image.copy()
    noisy[::2, ::2][labels[::2, ::2] == SKY + 1] = 100
    assert not find_sky_by_looks(noisy, frame.view.camera, labels).any()
