"""Moves: where things land, what turns with them, and that a moved car looks as it did."""

import numpy as np
import pytest
from random_scene import assert_same_scene, random_gaussians, random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.edits.queries.bake import bake_document, freeze_at_time, recount_table
from instdrive_core.edits.queries.ground_height import estimate_ground_height
from instdrive_core.edits.queries.placement import compute_bottom, compute_center
from instdrive_core.errors import EditError
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.lane import estimate_street_direction, estimate_travel_direction
from instdrive_core.scene.scene import scene_from_gaussians
from instdrive_core.scene.transforms import compute_current_means, copy_transformed

YAW_90 = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


def everything(document):
    scene = document.scene
    arrays = [document.transforms.indices, document.transforms.values, *scene.gaussians.arrays().values()]
    tracks = [track.world_from_box.tobytes() + track.dimensions.tobytes() for track in scene.actors]
    return [array.tobytes() for array in arrays], list(scene.table), tracks


def picture(scene, camera):
    gaussians = scene.gaussians
    colors = compute_colors(
        gaussians.means, gaussians.sh_dc, gaussians.sh_rest, camera.position, scene.nodes, np.eye(4)[None]
    )
    return render(gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacities, colors, camera).image


def test_a_moved_car_looks_the_same_from_the_same_relative_side():
    """Turned by any rotation, scaled and shifted, seen by a camera that went along."""
    scene = scene_from_gaussians(random_gaussians(np.random.default_rng(3), 300))
    scene.gaussians.log_scales[:] += 1
    scene.instance_ids[:] = 1
    document = Document(recount_table(scene))
    turn, scale = (0.8, 0.1, -0.3, 0.5), 1.5
    edit = MoveInstances((1,), (4.0, -2.0, 1.0), turn, scale, pivot=(0.5, 0.25, 0.0))
    pose = look_at(np.array([9.0, -8, 3]), np.zeros(3))
    camera = Camera(60.0, 60.0, 32.0, 24.0, 64, 48, pose)
    before = picture(scene, camera)
    document.apply(edit)
    matrix = edit_matrix(turn, scale, [4, -2, 1], [0.5, 0.25, 0])
    moved = pose.copy()
    moved[:3, :3] = matrix[:, :3] / scale @ pose[:3, :3]
    moved[:3, 3] = matrix[:, :3] @ pose[:3, 3] + matrix[:, 3]
    along = Camera(60.0, 60.0, 32.0, 24.0, 64, 48, moved)
    after = picture(bake_document(document), along)
    assert before.max() > 0.5
    np.testing.assert_allclose(after, before, atol=2e-3)
    unturned = bake_document(document)
    unturned.gaussians.sh_rest[:] = scene.gaussians.sh_rest
    assert np.abs(picture(unturned, along) - before).max() > 0.05, "the view-dependent colour has to turn"


def edit_matrix(quat, scale, shift, pivot):
    linear = scale * matrix_from_quaternion(np.array(quat))
    return np.c_[linear, np.array(pivot) + shift - linear @ pivot]


def test_moves_compose_and_undo_restores_every_bit():
    document = Document(random_scene())
    before, start = everything(document), document.scene.gaussians.means.copy()
    rows = document.find_rows((2,))
    document.apply(MoveInstances((2,), (1.0, 0.0, 0.0), pivot=(0.0, 0.0, 0.0)))
    document.apply(MoveInstances((2, 3), rotation=YAW_90, pivot=(0.0, 0.0, 0.0)))
    shifted = start[rows] + np.float32([1, 0, 0])
    turned = np.stack([-shifted[:, 1], shifted[:, 0], shifted[:, 2]], axis=1)
    np.testing.assert_allclose(document.compute_means(rows), turned, atol=1e-5)
    third = document.find_rows((3,))
    np.testing.assert_allclose(document.compute_means(third)[:, 0], -start[third][:, 1], atol=1e-5)
    assert len(document.transforms) == 4
    np.testing.assert_array_equal(document.scene.gaussians.means, start)
    np.testing.assert_allclose(document.scene.table[2].bounds, bounds(turned), atol=1e-5)
    after = everything(document)
    document.undo(), document.undo()
    assert everything(document) == before
    document.redo(), document.redo()
    assert everything(document) == after
    result = bake_document(document)
    np.testing.assert_allclose(result.gaussians.means[rows], turned, atol=1e-5)
    untouched = ~np.isin(document.scene.instance_ids, [2, 3])
    for name, array in document.scene.gaussians.arrays().items():
        assert getattr(result.gaussians, name)[untouched].tobytes() == array[untouched].tobytes(), name
    document.apply(MergeInstances((2,), 4))
    document.apply(MoveInstances((4,), (0.0, 0.0, 1.0)))
    np.testing.assert_allclose(document.compute_means(rows), turned + np.float32([0, 0, 1]), atol=1e-5)


def bounds(means):
    low, high = np.quantile(means, [0.03, 0.97], axis=0, method="nearest")
    return [low, high]


def test_there_and_back_again_leaves_the_identity_and_nothing_is_no_step():
    document = Document(random_scene())
    scene = bake_document(document)
    document.apply(MoveInstances((2,), (1.0, 0.5, 0.0)))
    document.apply(MoveInstances((2,), (-1.0, -0.5, 0.0)))
    assert_same_scene(bake_document(document), scene)
    cursor = document.history.cursor
    document.apply(MoveInstances((2,)))
    assert document.history.cursor == cursor


def test_of_a_moving_actor_the_track_is_moved():
    document = Document(random_scene())
    before, old = everything(document), document.scene.actors[0]
    time = 0.2
    here = old.interpolate_pose(time)[:3, 3]
    np.testing.assert_array_equal(compute_center(document, (7,), time), here)
    document.apply(MoveInstances((7,), (0.0, 3.0, 0.0), YAW_90, time=time))
    new = document.scene.actors[0]
    turn = matrix_from_quaternion(np.array(YAW_90))
    np.testing.assert_allclose(new.interpolate_pose(time)[:3, 3], here + np.array([0, 3, 0]), atol=1e-9)
    np.testing.assert_allclose(new.world_from_box[:, :3, :3], turn @ old.world_from_box[:, :3, :3], atol=1e-9)
    steps, old_steps = (np.diff(track.world_from_box[:, :3, 3], axis=0) for track in (new, old))
    np.testing.assert_allclose(steps, old_steps @ turn.T, atol=1e-9)
    assert not document.transforms.indices.any(), "no splat is touched"
    assert document.scene.actors[1] is Document(document.scene).scene.actors[1]
    result = freeze_at_time(bake_document(document), time).gaussians
    rows = np.flatnonzero(document.scene.nodes == 1)
    expected = (
        document.scene.gaussians.means[rows] @ new.interpolate_pose(time)[:3, :3].T + new.interpolate_pose(time)[:3, 3]
    )
    np.testing.assert_allclose(result.means[rows], expected, atol=1e-4)
    document.undo()
    assert everything(document) == before


def test_strays_of_an_actor_in_the_background_go_along_in_the_world():
    scene = random_scene()
    strays = np.flatnonzero(scene.nodes == 0)[:3]
    assert np.count_nonzero(scene.nodes == 1) > 3
    scene.instance_ids[strays] = 7
    document = Document(recount_table(scene))
    table, first = list(document.scene.table), document.scene.actors[0]
    assert document.scene.table[7].node == 1
    document.apply(MoveInstances((7,), (0.0, 3.0, 0.0), time=0.2))
    np.testing.assert_allclose(document.compute_means(strays), scene.gaussians.means[strays] + [0, 3, 0], atol=1e-5)
    assert np.count_nonzero(document.transforms.indices) == len(strays), "the others go along with the track"
    np.testing.assert_allclose(
        document.scene.actors[0].world_from_box[0, :3, 3] - first.world_from_box[0, :3, 3], [0, 3, 0]
    )
    assert document.scene.table[7].bounds == next(entry for entry in table if entry.id == 7).bounds
    document.undo()
    assert list(document.scene.table) == table
    document.apply(DuplicateInstances((7,), (1.0, 0.0, 0.0)))
    copy = document.scene.table[document.first_free_id - 1]
    assert (copy.node, copy.bounds) == (len(document.scene.actors), document.scene.table[7].bounds)


def test_a_scaled_actor_drives_as_far_as_before():
    document = Document(random_scene())
    old = document.scene.actors[0]
    document.apply(MoveInstances((7,), scale=2.0, time=0.2))
    new = document.scene.actors[0]
    np.testing.assert_allclose(new.dimensions, 2 * old.dimensions)
    np.testing.assert_allclose(new.world_from_box, old.world_from_box, atol=1e-12)
    rows = np.flatnonzero(document.scene.nodes == 1)
    np.testing.assert_array_equal(document.compute_means(rows), 2 * document.scene.gaussians.means[rows])
    assert not document.transforms.indices[document.scene.nodes != 1].any()
    result = bake_document(document).gaussians
    np.testing.assert_allclose(
        result.log_scales[rows], document.scene.gaussians.log_scales[rows] + np.log(2), atol=1e-6
    )


@pytest.mark.parametrize("length", [0.0, 1e-9, 1e200])
def test_turns_without_a_direction_are_refused(length):
    with pytest.raises(EditError, match="quaternion"):
        MoveInstances((1,), rotation=(length, 0.0, 0.0, length))


def test_locked_and_deleted_instances_stay():
    document = Document(random_scene())
    document.apply(LockInstances((2,)))
    document.apply(DeleteInstances((3,)))
    for instance_id, reason in ((2, "unlock"), (3, "deleted"), (77, "77")):
        with pytest.raises(EditError, match=reason):
            document.apply(MoveInstances((instance_id,), (1.0, 0.0, 0.0)))


SHARING = {
    "moved": lambda owner: MoveInstances((owner,), (1.0, 0.0, 0.0)),
    "scaled": lambda owner: MoveInstances((owner,), scale=2.0),
    "reset": lambda owner: ResetMoves((owner,)),
}


@pytest.mark.parametrize("make", SHARING.values(), ids=SHARING)
def test_what_is_locked_holds_the_track_that_it_shares(make):
    scene = random_scene()
    owner = next(entry.id for entry in scene.table if entry.node)
    node, part = scene.table[owner].node, max(entry.id for entry in scene.table) + 1
    rows = np.flatnonzero((scene.instance_ids == owner) & (scene.nodes == node))
    scene.instance_ids[rows[::2]] = part
    document = Document(recount_table(scene))
    assert document.scene.table[owner].node == document.scene.table[part].node == node
    document.apply(MoveInstances((owner,), (0.0, 1.0, 0.0)))
    document.apply(LockInstances((part,)))
    before = everything(document)
    with pytest.raises(EditError, match=f"instance {part} is locked"):
        document.apply(make(owner))
    assert everything(document) == before


# Constraints


def street(slope=0.1):
    """A car (instance 1) that hangs above a sloping road along x = y, cameras driving along it."""
    rng = np.random.default_rng(4)
    base = random_scene(count=4000, instances=2, actors=0, degree=0)
    gaussians = base.gaussians
    gaussians.opacity_logits[:] = 3
    car = np.arange(4000) < 500
    gaussians.means[car] = rng.uniform([-1, -2, 1], [1, 2, 2.5], (500, 3))
    gaussians.means[~car, :2] = rng.uniform(-30, 30, (3500, 2))
    gaussians.means[~car, 2] = slope * gaussians.means[~car, 0]
    gaussians.means[3900:, 2] -= 3  # floaters below the road
    base.instance_ids[:] = np.where(car, 1, 2)
    return recount_table(base)


def test_ground_snap_sets_the_car_on_the_road():
    document = Document(street())
    document.apply(MoveInstances((1,), (10.0, 0.0, 5.0), on_ground=True))
    foot = compute_bottom(document, (1,), np.eye(3, 4), 0.0)
    assert foot == pytest.approx(1.0, abs=0.06), "road at x = 10"
    np.testing.assert_allclose(compute_center(document, (1,), 0.0)[:2], [10, 0], atol=0.1)
    with pytest.raises(EditError, match="no ground"):
        document.apply(MoveInstances((1,), (500.0, 0.0, 0.0), on_ground=True))


def test_ground_ignores_what_stands_on_it_and_a_few_floaters_below():
    rng = np.random.default_rng(5)
    road = np.c_[rng.uniform(-4, 4, (400, 2)), rng.normal(1.5, 0.01, 400)]
    things = rng.uniform([-2, -2, 1.7], [2, 2, 6], (200, 3))
    below = rng.uniform([-2, -2, -3], [2, 2, 1], (8, 3))
    points = np.concatenate([things, road, below]).astype(np.float32)
    assert estimate_ground_height(points, np.zeros(3)) == pytest.approx(1.5, abs=0.02)
    assert estimate_ground_height(points, np.array([40.0, 0, 0])) is None


def test_two_layers_far_apart_still_have_a_ground():
    heights = np.repeat([0.0, 9.0], [2, 18]).astype(np.float32)
    offsets = np.random.default_rng(7).uniform(-1, 1, (20, 2))
    height = estimate_ground_height(np.c_[offsets, heights].astype(np.float32), np.zeros(3))
    assert height in (0.0, pytest.approx(9.0))


def test_yaw_only_drops_the_tilt():
    document = Document(street())
    tilted = MoveInstances((1,), rotation=(0.9, 0.2, -0.1, 0.3), yaw_only=True).compute_matrix(document)
    np.testing.assert_allclose(tilted[2, :3], [0, 0, 1], atol=1e-12)
    expected = 2 * np.arctan2(0.3, 0.9)
    assert np.arctan2(tilted[1, 0], tilted[0, 0]) == pytest.approx(expected)
    over = MoveInstances((1,), rotation=(0.0, 1.0, 0.0, 0.0), yaw_only=True).compute_matrix(document)
    np.testing.assert_array_equal(over[:, :3], np.eye(3))


def test_along_the_lane_follows_the_drive():
    scene = street()
    document = Document(scene)
    drive = np.stack([view.camera.position for view in scene.views])
    lane = estimate_travel_direction([drive], np.zeros(3))
    before = compute_center(document, (1,), 0.0)
    document.apply(MoveInstances((1,), (-3.0, 4.0, 7.0), along_lane=True))
    shift = compute_center(document, (1,), 0.0) - before
    np.testing.assert_allclose(shift, lane * (lane @ [-3, 4, 7]), atol=1e-5)


def test_a_driving_actor_keeps_to_its_own_lane():
    document = Document(random_scene())
    time, track = 0.1, document.scene.actors[0]
    forward = track.interpolate_pose(time)[:3, 1]
    document.apply(MoveInstances((7,), (2.0, 1.0, 3.0), along_lane=True, time=time))
    shift = document.scene.actors[0].interpolate_pose(time)[:3, 3] - track.interpolate_pose(time)[:3, 3]
    np.testing.assert_allclose(shift, forward * (forward @ [2, 1, 3]), atol=1e-9)


def test_lane_directions():
    turn = np.c_[np.r_[np.arange(0.0, 40), np.full(40, 40.0)], np.r_[np.zeros(40), np.arange(0.0, 40)], np.zeros(80)]
    np.testing.assert_allclose(estimate_travel_direction([turn], np.array([0.0, 5, 0])), [1, 0, 0], atol=0.03)
    np.testing.assert_allclose(estimate_travel_direction([turn[::-1]], np.array([45.0, 39, 0])), [0, -1, 0], atol=0.1)
    assert estimate_travel_direction([np.zeros((5, 3))], np.zeros(3)) is None
    assert estimate_travel_direction([], np.zeros(3)) is None
    rng = np.random.default_rng(6)
    along = rng.normal(size=(500, 3)) * [1, 10, 1]
    np.testing.assert_allclose(np.abs(estimate_street_direction(along, np.zeros(3))), [0, 1, 0], atol=0.05)
    assert estimate_street_direction(along[:1], np.zeros(3)) is None


def test_memory_is_that_of_the_rows_moved():
    document = Document(random_scene(count=20_000, instances=2_000))
    edit = MoveInstances((5,), (1.0, 0.0, 0.0))
    document.apply(edit)
    assert edit._rows.nbytes + edit._before.nbytes == 6 * len(document.find_rows((5,)))
    assert compute_current_means(document.scene.gaussians, document.transforms, document.find_rows((6,))).base is None


def test_what_is_drawn_of_some_rows_is_what_is_exported():
    document = Document(random_scene())
    document.apply(MoveInstances((2, 7), (1.0, 0.0, 0.0), (0.5, 0.5, 0.1, 0.2), 1.5))
    rows = np.array([5, 17, 150, 199, *document.find_rows((2,))[:5]])
    drawn, exported = (
        copy_transformed(document.scene.gaussians, document.transforms, rows),
        bake_document(document).gaussians,
    )
    for name, array in drawn.arrays().items():
        np.testing.assert_allclose(array, getattr(exported, name)[rows], atol=2e-6, err_msg=name)
    np.testing.assert_allclose(document.compute_means(rows), drawn.means, atol=1e-5)


@pytest.mark.parametrize(
    ("parameters", "title"),
    [
        ({"translation": (1.0, 0.0, 0.0)}, "Move instance 11"),
        ({"rotation": (0.9, 0.0, 0.0, 0.4), "pivot": (1.0, 2.0, 0.0)}, "Rotate instance 11"),
        ({"scale": 1.5}, "Scale instance 11"),
        ({"on_ground": True}, "Put instance 11 on the ground"),
        ({"scale": 1.5, "rotation": (0.9, 0.0, 0.0, 0.4)}, "Move instance 11"),
    ],
)
def test_the_title_says_what_was_done(parameters, title):
    assert MoveInstances((11,), **parameters).title == title
