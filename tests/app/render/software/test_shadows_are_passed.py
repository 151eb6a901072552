"""In the editor's view no pixel stands for a shadow's splat, in sharp frames and in drafts of either kind."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR

from instdrive_app import camera
from instdrive_app.render.software.draw import FrameRequest, SoftwareDraw
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.state import EditorState, ViewMode, resolve
from instdrive_core.instances.shadows import LEARNED_SHADOW, SYNTHETIC
from instdrive_core.maths.activations import logit

SIZE = (300, 180)
BLUE_CAR = FIRST_CAR + 1


def draw(document, drawer, draft=False, view_mode=ViewMode.COLOR):
    """The frame, and the instances that its pixels stand for."""
    view = document.scene.views[0]
    state = EditorState(viewpoint=camera.view_from_camera(view), time=view.time, view_mode=view_mode)
    request = FrameRequest(SceneWatcher(document).take_state(), resolve(state, *SIZE, draft=draft))
    drawer(request)
    drawer.wait_for_detail()
    frame = drawer(request)
    return frame, np.append(document.scene.instance_ids, np.uint32(0))[frame.winner]


def thin(document):
    """Let some light through the car, as shadows do."""
    document.scene.gaussians.opacity_logits[document.scene.instance_ids == BLUE_CAR] = logit(np.array([0.05]))


def mark(document):
    """Take the car's splats for those of a shadow: the same picture, through which one points."""
    is_car = document.scene.instance_ids == BLUE_CAR
    document.scene.extra[SYNTHETIC] = np.where(is_car, LEARNED_SHADOW, 0).astype(np.uint8)


@pytest.mark.parametrize("draft", [False, True])
@pytest.mark.parametrize("fewest", [0, 10**9])
def test_one_points_through_a_shadow(street, draft, fewest):
    thin(street)
    _, before = draw(street, SoftwareDraw(fewest), draft)
    mark(street)
    _, through = draw(street, SoftwareDraw(fewest), draft)
    was_car = before == BLUE_CAR
    assert was_car.any()
    assert not (through == BLUE_CAR).any()
    assert ((through > 0) & was_car).sum() > 0.9 * was_car.sum()


def test_the_picture_is_the_same(street):
    plain, _ = draw(street, SoftwareDraw())
    mark(street)
    through, _ = draw(street, SoftwareDraw())
    np.testing.assert_array_equal(plain.picture, through.picture)


def test_rings_show_splats_one_by_one_so_each_can_be_pointed_at(street):
    mark(street)
    _, ids = draw(street, SoftwareDraw(), view_mode=ViewMode.RINGS)
    assert (ids == BLUE_CAR).any()
