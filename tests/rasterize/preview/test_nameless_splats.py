"""Shadows are drawn, but no pixel stands for their splats: one points through them at what lies in them."""

import numpy as np
import pytest

from instdrive_core.instances.shadows import LEARNED_SHADOW, MIRRORED, SHADOW, SYNTHETIC, name_splats
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.scene.camera import Camera

CAMERA = Camera(20.0, 20.0, 8.0, 8.0, 16, 16, np.eye(4))
MIDDLE = (8, 8)
NAMELESS = -1


def draw(opacities, names):
    """Splats one behind the other, wide enough to fill the picture."""
    count = len(opacities)
    means = np.column_stack([np.zeros(count), np.zeros(count), 5 + np.arange(count)]).astype(np.float32)
    quats, scales = np.tile(np.float32([1, 0, 0, 0]), (count, 1)), np.full((count, 3), 2.0, np.float32)
    colors = np.linspace(0, 1, 3 * count, dtype=np.float32).reshape(count, 3)
    arrays = means, quats, scales, np.array(opacities, np.float32), colors
    return render_preview(*arrays, CAMERA, names=np.array(names, np.int32))


@pytest.mark.parametrize(
    ("opacities", "names", "winner"),
    [
        ([0.9, 0.9], [0, 1], 0),
        ([0.9, 0.9], [NAMELESS, 1], 1),
        ([0.6, 0.6, 0.9], [NAMELESS, 1, 2], 1),
        ([0.2, 0.2, 0.2, 0.2], [0, NAMELESS, 2, 3], 0),
        ([0.2, 0.2, 0.2, 0.2], [NAMELESS, NAMELESS, 2, 3], 2),
        ([0.9], [NAMELESS], -1),
        ([0.9, 0.9], [NAMELESS, 7], 7),
    ],
)
def test_a_pixel_stands_for_what_has_a_name(opacities, names, winner):
    assert draw(opacities, names).winner[MIDDLE] == winner


def test_what_has_no_name_is_drawn_as_before():
    drawn, named = draw([0.6, 0.5, 0.9], [NAMELESS, 1, NAMELESS]), draw([0.6, 0.5, 0.9], [])
    np.testing.assert_array_equal(drawn.color, named.color)
    np.testing.assert_array_equal(drawn.depth, named.depth)


def test_shadows_have_no_name_whether_they_were_laid_or_learned():
    column = np.array([0, 1, SHADOW, MIRRORED, LEARNED_SHADOW], np.uint8)
    np.testing.assert_array_equal(name_splats({SYNTHETIC: column}), [0, 1, NAMELESS, 3, NAMELESS])
    assert len(name_splats({SYNTHETIC: column[:2]})) == len(name_splats({})) == 0
