"""Standing scenes upright, without a window: the guess that is told, the view, and what knows "up" after it."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street
from session_driver import errors, finish

from instdrive_app.camera import look_straight_down
from instdrive_app.framing import frame_scene
from instdrive_app.panels.dialogs.turn_upright import describe_guess, describe_turn
from instdrive_app.panels.overlays.upright_bar import describe_offer
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.scene.camera import look_at
from instdrive_core.scene.scene import scene_from_gaussians
from instdrive_core.scene.upright import AXES, compute_axis_direction, format_axis

DOWN = np.array([0.0, -1.0, 0.0])
ASKEW = np.array([0.1, -0.9, 0.3])
FROM, ALONG_X = np.array([-5.0, 1.0, 3.0]), np.array([1.0, 0.1, 0.0])


def told_texts(session):
    return [message.text for message in session.messages.log]


@pytest.mark.parametrize("axis", [axis for axis in AXES if axis != "+z"])
def test_a_foreign_street_that_lies_is_told_of_and_turned_by_nobody(session, axis):
    scene = procedural_street()
    bare = scene_from_gaussians(scene.gaussians.select(scene.nodes == 0))
    document = Document(bare)
    document.apply(
        TurnScene.make_upright(tuple((compute_axis_direction(axis) * [-1, -1, 1]).tolist()))
    )  # takes +z to the axis
    session.show(Document(bake_document(document)))
    finish(session)
    (said,) = [text for text in told_texts(session) if "Turn upright…" in text]
    assert f"{format_axis(axis)} is up, judging by the ground" in said
    assert session.document.history.cursor == 0


def test_own_scenes_and_upright_ones_are_not_told_of(session):
    finish(session)
    scene = procedural_street()
    session.show(Document(scene_from_gaussians(scene.gaussians.select(scene.nodes == 0))))
    finish(session)
    assert not [text for text in told_texts(session) if "Turn upright…" in text]


@pytest.mark.parametrize("up", [DOWN, ASKEW], ids=["quarter", "askew"])
def test_the_view_goes_along_and_comes_back(session, up):
    """What stood in the middle of the picture stays there; the picture is upright."""
    navigation, document = session.navigation, session.document
    navigation.look_from(replace(session.state.viewpoint, world_from_camera=look_at(FROM, FROM + ALONG_X)))
    before = session.state.viewpoint
    session.orientation.turn(up, 2.0)
    finish(session)
    session.tick(0.0)
    after = session.state.viewpoint
    assert document.history.cursor == len(document.history.edits) > 0
    np.testing.assert_allclose(after.pivot, document.orientation[:, :3] @ before.pivot, atol=1e-6)
    assert after.pivot_distance == pytest.approx(2 * before.pivot_distance)
    assert abs(after.world_from_camera[2, 0]) < 1e-9, "no roll"
    assert after.world_from_camera[2, 1] < 0, "the picture's down is not up"
    session.history.undo()
    session.tick(0.0)
    np.testing.assert_allclose(session.state.viewpoint.pivot, before.pivot, atol=1e-6)
    np.testing.assert_array_equal(document.orientation, np.eye(3, 4))
    assert not errors(session)


def test_where_the_view_would_look_from_below_or_straight_down_all_is_in_view(session):
    for ahead in (np.array([0.0, 1.0, 0.0]), np.array([0.1, -1.0, 0.1])):  # downwards, upwards after the turn
        session.navigation.look_from(replace(session.state.viewpoint, world_from_camera=look_at(FROM, FROM + ahead)))
        session.orientation.turn(DOWN)
        session.tick(0.0)
        expected = frame_scene(session.navigation.compute_world_means(()))
        np.testing.assert_array_equal(session.state.viewpoint.world_from_camera, expected.world_from_camera)
        session.history.undo()
        session.tick(0.0)


def test_a_dataset_camera_is_looked_through_after_as_before(session):
    session.navigation.look_through(2)
    shown = session.state.viewpoint.world_from_camera
    session.orientation.turn(DOWN)
    session.tick(0.0)
    assert session.state.dataset_view == 2
    assert not np.allclose(session.state.viewpoint.world_from_camera, shown)
    view = session.document.scene.views[2]
    np.testing.assert_array_equal(session.state.viewpoint.world_from_camera, view.camera.world_from_camera)
    session.history.undo()
    session.tick(0.0)
    np.testing.assert_array_equal(session.state.viewpoint.world_from_camera, shown)


def test_what_is_up_in_the_view_means_the_axis_when_it_is_near(session):
    points = session.navigation.compute_world_means(())
    session.navigation.look_from(look_straight_down(session.state.viewpoint, points))
    up, angle = session.orientation.find_view_up()
    assert sorted(np.abs(up)) == [0, 0, 1]
    assert angle <= 10
    session.navigation.look_down(())
    assert session.orientation.find_view_up()[0][2] == 0, "from above, up in the picture is level"


def test_after_the_turn_boxes_numbers_ground_and_resets_know_up(session):
    """A street that lies on its side, turned upright, is edited as the same street that never lay."""
    scene = procedural_street()
    upright = Document(scene)
    fallen = Document(scene)
    fallen.apply(TurnScene.make_upright((0.0, 1.0, 0.0)))
    raised = Document(bake_document(fallen))
    found = {}
    for name, document in (("upright", upright), ("raised", raised)):
        session.show(document)
        if name == "raised":
            session.orientation.turn(DOWN)
            session.tick(0.0)
        session.selection.select((FIRST_CAR,))
        session.state.time = 0.0
        box, placement = session.movement.find_box(), session.movement.find_placement()
        session.movement.options.on_ground = True
        session.movement.begin_drag(np.eye(3))
        session.movement.drag_to(np.array([1.0, 0.5, 2.0]), np.eye(3), 1.0)
        session.movement.end_drag()
        moved = session.document.compute_means(session.document.find_rows((FIRST_CAR,)))
        session.movement.reset()
        back = session.document.compute_means(session.document.find_rows((FIRST_CAR,)))
        found[name] = (box.corners, placement.position, placement.yaw, placement.scale, moved, back)
        assert not errors(session)
    for mine, theirs in zip(*found.values(), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-4)


def test_the_render_thread_gets_the_turned_sky(session):
    watcher = SceneWatcher(session.document)
    before = watcher.take_state().sky
    session.orientation.turn(DOWN)
    assert watcher.take_state().sky is session.document.scene.sky
    session.history.undo()
    assert watcher.take_state().sky is before


def test_copies_of_the_turned_lie_as_the_turned(session):
    session.orientation.turn(DOWN)
    document = session.document
    document.apply(DuplicateInstances((FIRST_CAR,), (0.0, 3.0, 0.0)))
    copy = max(entry.id for entry in document.scene.table)
    rows, copied = document.find_rows((FIRST_CAR,)), document.find_rows((copy,))
    np.testing.assert_allclose(
        document.compute_means(copied), document.compute_means(rows) + np.float32([0, 3, 0]), atol=1e-5
    )


def test_the_dialog_says_what_will_happen_and_how_it_knows(session):
    scene = session.document.scene
    assert describe_turn(compute_axis_direction("+z"), 1.0, scene) == "Nothing changes: +Z is already up."
    assert describe_turn(DOWN, 1.0, scene).startswith("The whole scene turns by 90°, so that −Y points up.")
    assert "the direction 19° from −Y" in describe_turn(ASKEW, 0.01, scene)
    assert "0.01 times as large" in describe_turn(ASKEW, 0.01, scene)
    assert describe_turn(DOWN, 1.0, scene).endswith(
        " This changes with it: the drives, the photos' cameras, the sky. You can undo this."
    )
    parked = scene_from_gaussians(scene.gaussians)
    assert " This changes with it: the sky." in describe_turn(DOWN, 1.0, replace(parked, sky=scene.sky))
    assert " This changes with it: the photos' cameras." in describe_turn(DOWN, 1.0, replace(parked, views=scene.views))
    assert describe_guess(None) == "Estimating which way is up…"
    session.orientation.guess_up()
    finish(session)
    assert describe_guess(session.orientation.estimate) == "Guess: +Z, according to the photos' cameras."


def test_the_bar_turns_flips_and_leaves(session):
    rng = np.random.default_rng(4)
    ball = procedural_street().gaussians.select(rng.integers(0, 2000, 600))
    ball.means[:] = rng.normal(0, 1, (600, 3))
    session.show(Document(scene_from_gaussians(ball)))
    finish(session)
    orientation = session.orientation
    assert not orientation.offer.estimate.confident, "nothing says what is up in a ball"
    assert describe_offer(orientation.offer) == "Nothing says which way is up in this scene"
    orientation.accept_offer()
    np.testing.assert_allclose(session.document.orientation[:, :3] @ DOWN, [0, 0, 1], atol=1e-9)
    assert orientation.offer.is_answered
    orientation.flip()
    np.testing.assert_allclose(session.document.orientation[:, :3] @ DOWN, [0, 0, -1], atol=1e-9)
    orientation.dismiss_offer()
    assert orientation.offer is None
    assert session.document.history.cursor == 2
    session.show(Document(procedural_street()))
    finish(session)
    assert orientation.offer is None, "own scenes are upright"
