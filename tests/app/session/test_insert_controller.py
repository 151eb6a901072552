"""Inserting scenes: before the camera, side by side, on the ground; what cannot be read is told."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street
from session_driver import errors, finish

from instdrive_app.state import Intrinsics, Viewpoint
from instdrive_core.formats.clouds.sample_files import build_pcd
from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.camera import look_at
from instdrive_core.scene.scene import scene_from_gaussians

TREE = 30
LENS = Intrinsics(500.0, 500.0, 320.0, 180.0, 640, 360)


@pytest.fixture
def session(session):
    session.selection.select((FIRST_CAR,))
    return session


def car_file(folder, instances=False):
    scene = procedural_street()
    rows = np.isin(scene.instance_ids, (FIRST_CAR + 4, TREE)) if instances else scene.instance_ids == FIRST_CAR + 4
    part = scene_from_gaussians(scene.gaussians.select(np.flatnonzero(rows)))
    part.gaussians.means[:] += np.float32([100, 0, 40])
    if instances:
        part.instance_ids[:] = scene.instance_ids[rows]
        part.table.instances |= {i: scene.table[i] for i in (FIRST_CAR + 4, TREE)}
    path = folder / "car.ply"
    save_scene(path, part)
    return path


@pytest.mark.parametrize("instances", [False, True])
def test_an_inserted_scene_stands_before_the_camera_on_the_ground(session, street, tmp_path, instances):
    street.open_scene = None
    session.state.viewpoint = Viewpoint(look_at(np.array([0.0, 0, 2]), np.array([0.0, 10, 2])), LENS)
    steps = street.history.cursor
    session.insertion.insert(car_file(tmp_path, instances))
    finish(session)
    assert not errors(session)
    added = session.selection.ids
    assert len(added) == (2 if instances else 1)
    assert street.history.cursor == steps + 1
    assert session.state.tool == "move"
    rows = street.find_rows(added)
    means = street.compute_means(rows)
    assert np.quantile(means[:, 2], 0.02) == pytest.approx(0, abs=0.15)
    assert abs(np.mean(np.quantile(means[:, 0], [0.03, 0.97]))) < 0.2
    assert 6 < np.mean(np.quantile(means[:, 1], [0.03, 0.97])) < 40
    session.history.undo()
    assert session.selection.ids == (FIRST_CAR,)
    assert len(street.scene) == len(procedural_street())


def test_several_scenes_stand_side_by_side_and_are_selected_together(session, street, tmp_path):
    session.state.viewpoint = Viewpoint(look_at(np.array([0.0, 0, 2]), np.array([0.0, 10, 2])), LENS)
    (tmp_path / "broken.ply").write_bytes(b"ply\nnonsense")
    (tmp_path / "more").mkdir()
    car, two = car_file(tmp_path), car_file(tmp_path / "more", instances=True)
    paths = [car, tmp_path / "broken.ply", two, car]
    steps = street.history.cursor
    session.insertion.insert(*paths)
    finish(session)
    assert ["broken.ply" in error for error in errors(session)] == [True]
    assert street.history.cursor == steps + 3
    edges = []
    for first, count in ((0, 1), (1, 2), (3, 1)):
        means = street.compute_means(street.find_rows(session.selection.ids[first : first + count]))
        low, high = np.quantile(means, [0.03, 0.97], axis=0)
        assert 6 < (low[1] + high[1]) / 2 < 40, "before the camera"
        edges += [low[0], high[0]]
    assert np.all(np.diff(edges) > 0), "from left to right, with room between them"


def test_a_scene_inserted_where_no_ground_is_stands_below_the_camera_and_that_is_told(session, street, tmp_path):
    session.state.viewpoint = Viewpoint(look_at(np.array([500.0, 0, 12]), np.array([500.0, 10, 12])), LENS)
    session.insertion.insert(car_file(tmp_path))
    finish(session)
    means = street.compute_means(street.find_rows(session.selection.ids))
    assert np.quantile(means[:, 2], 0.02) == pytest.approx(12 - 1.6, abs=0.05)
    assert "no ground" in session.messages.log[-1].text


def test_what_cannot_be_inserted_is_told(session, street, tmp_path):
    (tmp_path / "broken.ply").write_bytes(b"ply\nnonsense")
    steps = street.history.cursor
    session.insertion.insert(tmp_path / "broken.ply")
    finish(session)
    assert "broken.ply" in errors(session)[-1]
    assert street.history.cursor == steps


def lying_car(folder, name):
    """The file of a car of another program, with y down: two of its lengths, in x and y, become height and width."""
    car = procedural_street()
    part = scene_from_gaussians(car.gaussians.select(np.flatnonzero(car.instance_ids == FIRST_CAR + 4)))
    part.gaussians.means[:] = part.gaussians.means @ np.float32([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    save_scene(folder / name, part)
    return folder / name


def heights(street, ids):
    means = street.compute_means(street.find_rows(ids))
    return np.quantile(means[:, 2], [0.02, 0.98])


def test_an_inserted_scene_of_another_program_is_asked_about_and_stands_up(session, street, tmp_path):
    session.state.viewpoint = Viewpoint(look_at(np.array([0.0, 0, 2]), np.array([0.0, 10, 2])), LENS)
    session.insertion.insert(lying_car(tmp_path, "car.ply"), lying_car(tmp_path, "second.ply"))
    finish(session)
    first = session.orientation.offer
    assert first.ids == session.selection.ids[:1]
    assert np.diff(heights(street, first.ids)) > 3, "it lies on its bumper"
    steps = street.history.cursor
    session.orientation.accept_offer()
    assert street.history.cursor == steps + 1
    low, high = heights(street, first.ids)
    assert low == pytest.approx(0, abs=0.15)
    assert high < 2
    assert np.array_equal(street.orientation, np.eye(3, 4)), "the scene itself stays"
    assert session.orientation.offer.is_answered
    session.orientation.flip()
    assert heights(street, first.ids)[0] == pytest.approx(0, abs=0.15)
    session.orientation.dismiss_offer()
    assert session.orientation.offer.ids == session.selection.ids[1:], "the second one is asked about next"
    while street.history.cursor:
        session.history.undo()
    session.tick(0.0)
    assert session.orientation.offer is None, "what it asked about is gone"


def test_inserted_scenes_of_our_own_are_not_asked_about(session, street, tmp_path):
    session.insertion.insert(car_file(tmp_path, instances=True))
    finish(session)
    assert session.orientation.offer is None


def test_a_cloud_of_points_stays_where_its_coordinates_have_it(session, street, tmp_path):
    """Beside a scene whose origin is another one; a cloud of another town stands before the camera."""
    points = np.random.default_rng(0).uniform(0, 4, (300, 3)) + np.array([2.0, 8.0, 0.0])
    colors = np.full((300, 3), 90)
    street.scene.origin = np.array([1000.0, 2000.0, 10.0])
    for name, corner in (("here", street.scene.origin), ("elsewhere", np.array([9e4, 2000.0, 10.0]))):
        (tmp_path / f"{name}.pcd").write_bytes(build_pcd(points + corner, colors, "binary"))
        session.insertion.insert(tmp_path / f"{name}.pcd")
        finish(session)
        means = street.compute_means(street.find_rows(session.selection.ids))
        if name == "here":
            np.testing.assert_allclose(means, points, atol=1e-3)
            assert "where its coordinates have it" in session.messages.log[-1].text
        else:
            assert np.linalg.norm(means.mean(axis=0) - session.state.viewpoint.position) < 100
