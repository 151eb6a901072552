"""Colours are kept while splats are seen from one place, and whatever changes them is shown at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD

from instdrive_app import camera
from instdrive_app.render.software import draw
from instdrive_app.render.software.draw import FrameRequest, SoftwareDraw
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.state import EditorState, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances

SIZE = (300, 180)


@pytest.fixture
def shiny(street):
    """The street, each splat in other colours from other sides."""
    scene, rng = street.scene, np.random.default_rng(0)
    rest = rng.normal(0, 0.1, (len(scene.gaussians), 15, 3)).astype(np.float32)
    return Document(replace(scene, gaussians=replace(scene.gaussians, sh_rest=rest)))


def _count_recalled(monkeypatch):
    """Shares of splats whose colours are known before each frame."""
    shares, recall = [], draw.ColorMemory.recall

    def count(memory, *given):
        colors = recall(memory, *given)
        shares.append(float(np.unpackbits(colors.known.view(np.uint8)).mean()))
        return colors

    monkeypatch.setattr(draw.ColorMemory, "recall", count)
    return shares


def test_frames_are_what_they_were_without_it_whatever_changes(shiny, monkeypatch):
    shares = _count_recalled(monkeypatch)
    watcher, kept = SceneWatcher(shiny), SoftwareDraw(fewest=10**9)
    first, other = (shiny.scene.views[index] for index in (0, 3))
    look = camera.view_from_camera(first)
    steps = [
        (look, 0.0, None, False),
        (camera.look(look, 0.4, 0.1), 0.0, None, True),
        (look, 0.0, DeleteInstances((FIRST_CAR,)), True),
        (look, 0.0, RecolorInstances((ROAD,), "tint", (0.9, 0.4, 0.1)), False),
        (look, 0.0, MoveInstances((FIRST_CAR + 1,), (-2.0, 1.0, 0.3), (0.5**0.5, 0, 0, 0.5**0.5), 0.7), False),
        (look, 1.0, None, False),  # what drives turns its colours
        (look, 1.0, DuplicateInstances((DRIVING_CAR,), (-3.0, 2.0, 0.0)), False),
        (camera.view_from_camera(other), 1.0, None, False),
        (camera.look(camera.view_from_camera(other), -0.3, 0.0), 1.0, None, True),
    ]
    for step, (view, time, edit, recalls) in enumerate(steps):
        if edit is not None:
            shiny.apply(edit)
        request = FrameRequest(watcher.take_state(), resolve(EditorState(viewpoint=view, time=time), *SIZE))
        shown = kept(request)
        assert (shares.pop() > 0.05) == recalls, step
        fresh = SoftwareDraw(fewest=10**9)(request)
        assert shares.pop() == 0
        np.testing.assert_array_equal(shown.picture, fresh.picture, err_msg=str(step))
        np.testing.assert_array_equal(shown.winner, fresh.winner)
    again = kept(FrameRequest(watcher.take_state(), replace(request.snapshot, show_sky=False)))
    assert shares.pop() > 0.05
    assert again.picture.any()


def test_splats_that_look_alike_from_everywhere_are_not_remembered(street, monkeypatch):
    bare = replace(street.scene.gaussians, sh_rest=np.zeros((len(street.scene.gaussians), 0, 3), np.float32))
    document = Document(replace(street.scene, gaussians=bare))
    sizes, recall = [], draw.ColorMemory.recall
    monkeypatch.setattr(
        draw.ColorMemory, "recall", lambda *given: sizes.append(len((colors := recall(*given)).colors)) or colors
    )
    view = camera.view_from_camera(document.scene.views[0])
    SoftwareDraw()(FrameRequest(SceneWatcher(document).take_state(), resolve(EditorState(viewpoint=view), *SIZE)))
    assert sizes == [0]


def test_zeros_of_either_sign_are_one_place(shiny, monkeypatch):
    shares = _count_recalled(monkeypatch)
    watcher, kept = SceneWatcher(shiny), SoftwareDraw(fewest=10**9)
    look = camera.view_from_camera(shiny.scene.views[0])
    for zero, show_sky in ((0.0, True), (-0.0, False)):
        pose = look.world_from_camera.copy()
        pose[1, 3] = zero
        state = EditorState(viewpoint=replace(look, world_from_camera=pose), show_sky=show_sky)
        kept(FrameRequest(watcher.take_state(), resolve(state, *SIZE)))
    assert shares[0] == 0 < shares[1]
