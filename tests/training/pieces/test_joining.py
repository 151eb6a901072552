"""Scenes made by hand, joined: no Gaussian twice, one ID for one thing, one brightness."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.datasets.clip import Clip, Frame, is_held_out
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.exposure import Exposures, apply_exposure
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.sky_fill import SkyEvidence
from instdrive_core.scene.track import Track
from instdrive_core.training.pieces.colors import align_colors, change_colors
from instdrive_core.training.pieces.cut import cut_clip, list_steps
from instdrive_core.training.pieces.identities import InstanceUnion, SharedPixels, match_instances
from instdrive_core.training.pieces.joining import join_pieces
from instdrive_core.training.pieces.plan import Piece
from instdrive_core.training.pieces.skies import SeenSky, join_skies

STEPS = 12
PIECES = (Piece(0, 7, 0, 5, 7.0), Piece(4, 11, 6, 11, 7.0))
WALL, POST = 1, 2
MOVER = "mover"


def view(step):
    """A camera at x = step that looks along +y at the wall."""
    place = np.array([float(step), 0.0, 1.0])
    camera = Camera(40.0, 40.0, 32.0, 18.0, 64, 36, look_at(place, place + np.array([0, 1.0, 0])))
    return CameraView(camera, "front", step, 0.1 * step, "", is_held_out(step))


def mover(shift=0.0):
    """A box that drives along in front of the wall; `shift` is what a piece corrected."""
    poses = np.tile(np.eye(4), (STEPS, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = np.arange(STEPS) + shift, 4.0, 0.5
    return Track(MOVER, "Car", np.array([1.0, 1.0, 1.0]), 0.1 * np.arange(STEPS), poses, True)


def clip():
    frames = tuple(Frame(view(step), lambda: np.zeros((36, 64, 3), np.uint8)) for step in range(STEPS))
    return Clip("street", "street", np.zeros(3), frames, (), (mover(),), {}, ("front",))


def gaussians(means, color):
    count = len(means)
    return Gaussians(
        means=np.asarray(means, np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), np.log(0.15), np.float32),
        opacity_logits=np.full(count, 4.0, np.float32),
        sh_dc=np.broadcast_to(dc_from_color(np.asarray(color, np.float32)), (count, 3)).astype(np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 4), np.float32),
    )


def wall(x):
    """A wall at y = 6 along x, a Gaussian every 25 cm."""
    grid = np.stack(np.meshgrid(x, [6.0], np.arange(0, 2.5, 0.25)), axis=-1)
    return grid.reshape(-1, 3)


def piece_scene(piece, ids=(WALL, POST), color=0.5, shift=0.0, gain=None):
    """What a piece makes of the whole wall, of the post that stands at the border, and of the mover."""
    background = wall(np.arange(-4, 16, 0.25))
    post = np.stack([np.full(8, 5.5), np.full(8, 5.0), np.arange(0, 2, 0.25)], axis=1)
    car = np.random.default_rng(0).uniform(-0.4, 0.4, (30, 3)) - [shift, 0, 0]
    parts = [gaussians(background, [color] * 3), gaussians(post, [0.9, 0, 0]), gaussians(car, [0, 0, 0.9])]
    merged = Gaussians(**{name: np.concatenate([part.arrays()[name] for part in parts]) for name in parts[0].arrays()})
    sizes = [len(part) for part in parts]
    instance_ids = np.repeat(np.array([*ids, 9], np.uint32), sizes)
    nodes = np.repeat(np.array([0, 0, 1], np.uint16), sizes)
    views = tuple(view(step) for step in range(piece.first, piece.last + 1))
    exposures = None
    if gain is not None:
        keys = [f"front/{each.index:02d}" for each in views if not each.held_out]
        matrices = np.tile(np.eye(3, 4, dtype=np.float32) * gain, (len(keys), 1, 1))
        exposures = Exposures(tuple(keys), np.arange(len(keys)) * 0.1, matrices)
    classes = {ids[0]: "Building", ids[1]: "Pole", 9: "Car"}
    return Scene(
        gaussians=merged,
        instance_ids=instance_ids,
        codewords=instance_ids.copy(),
        nodes=nodes,
        table=build_instance_table(instance_ids, merged.means, instance_ids, nodes, None, classes),
        actors=(mover(shift),),
        sky=Sky(np.full((6, 8, 8, 3), color, np.float32)),
        views=views,
        exposures=exposures,
        code_bits=4,
    )


def join(*scenes, pieces=PIECES):
    return join_pieces(clip(), pieces, scenes.__getitem__)


def test_no_gaussian_is_doubled_and_none_is_lost():
    one, other = piece_scene(PIECES[0]), piece_scene(PIECES[1])
    joined = join(one, other)
    assert len(joined) == len(one)
    found = {tuple(row) for row in np.round(joined.gaussians.means, 3).tolist()}
    assert found == {tuple(row) for row in np.round(one.gaussians.means, 3).tolist()}


def test_each_side_of_the_border_has_the_gaussians_of_its_piece():
    one, other = piece_scene(PIECES[0], color=0.2), piece_scene(PIECES[1], color=0.8)
    joined = join(one, other)
    on_wall = (joined.nodes == 0) & (joined.gaussians.means[:, 1] > 5.5)
    x, red = joined.gaussians.means[on_wall, 0], color_from_dc(joined.gaussians.sh_dc[on_wall])[:, 0]
    np.testing.assert_allclose(red[x < 5.4], 0.2, atol=1e-3)
    np.testing.assert_allclose(red[x > 5.6], 0.8, atol=1e-3)


def test_a_long_thing_and_one_at_the_border_keep_one_id_whatever_pieces_called_them():
    joined = join(piece_scene(PIECES[0]), piece_scene(PIECES[1], ids=(7, 3)))
    assert len(joined.table) == 3
    assert sorted(instance.class_name for instance in joined.table) == ["Building", "Car", "Pole"]
    on_wall = (joined.nodes == 0) & (joined.gaussians.means[:, 1] > 5.5)
    assert len(np.unique(joined.instance_ids[on_wall])) == 1
    assert len(np.unique(joined.codewords)) == 3


def test_equal_numbers_of_two_pieces_mean_nothing():
    """What the one calls wall the other calls post."""
    joined = join(piece_scene(PIECES[0]), piece_scene(PIECES[1], ids=(POST, WALL)))
    on_wall = (joined.nodes == 0) & (joined.gaussians.means[:, 1] > 5.5)
    assert len(np.unique(joined.instance_ids[on_wall])) == 1
    assert len(joined.table) == 3


def test_a_mover_is_one_node_and_its_gaussians_fit_the_poses_of_both_pieces():
    joined = join(piece_scene(PIECES[0]), piece_scene(PIECES[1], shift=0.2))
    assert [actor.id for actor in joined.actors] == [MOVER]
    rows = joined.nodes == 1
    assert rows.sum() == 30
    assert len(np.unique(joined.instance_ids[rows])) == 1
    for time in (0.1, 1.0):  # the middle of the car's body is where it was in both
        pose = joined.actors[0].interpolate_pose(time)
        middle = joined.gaussians.means[rows].mean(axis=0) + pose[:3, 3]
        expected = piece_scene(PIECES[0]).gaussians.means[-30:].mean(axis=0) + mover().interpolate_pose(time)[:3, 3]
        np.testing.assert_allclose(middle, expected, atol=1e-3)


def test_pieces_that_took_another_brightness_for_neutral_agree():
    """The second piece is darker, and its photos' exposures brighter by as much."""
    one, other = piece_scene(PIECES[0], color=0.6, gain=1.0), piece_scene(PIECES[1], color=0.3, gain=2.0)
    joined = join(one, other)
    on_wall = (joined.nodes == 0) & (joined.gaussians.means[:, 1] > 5.5)
    red = color_from_dc(joined.gaussians.sh_dc[on_wall])[:, 0]
    np.testing.assert_allclose(red, red[0], atol=1e-3)
    for step, scene in ((1, one), (10, other)):
        camera, time = view(step).camera, view(step).time
        before = apply_exposure(view_scene(scene, camera, time).color, scene.exposures.interpolate("front", time))
        after = apply_exposure(view_scene(joined, camera, time).color, joined.exposures.interpolate("front", time))
        np.testing.assert_allclose(after[18, 8], before[18, 8], atol=0.02)


def test_colours_stay_where_there_are_no_exposures():
    changes = align_colors([None, None, None])
    np.testing.assert_allclose(changes, np.tile(np.eye(4), (3, 1, 1)))
    scene = piece_scene(PIECES[0])
    assert change_colors(scene, np.eye(4)) is scene


def test_pairs_are_mutual_and_large_enough():
    def pairs(*rows):
        table = np.array(rows, np.int64)
        return match_instances(SharedPixels(table[:, 0], table[:, 1], table[:, 2]))

    assert pairs((1, 5, 900), (1, 6, 100), (2, 6, 400)) == [(1, 5), (2, 6)]
    assert pairs((1, 5, 900), (2, 5, 400)) == [(1, 5)]
    assert pairs((1, 5, 10)) == []
    assert pairs((1, 5, 100), (1, 6, 100), (1, 7, 100), (1, 8, 100), (1, 9, 100)) == []
    assert match_instances(SharedPixels(*(np.zeros(0, np.int64),) * 3)) == []


def test_what_is_joined_with_one_is_joined_with_all():
    union = InstanceUnion()
    union.join([(2, 1), (3, 4)])
    union.join([(1, 7), (2, 1)])
    assert union.find((3, 4)) == union.find((1, 7)) == (1, 7)
    assert union.find((3, 5)) == (3, 5)


def test_a_direction_takes_the_sky_of_the_piece_that_saw_it():
    bright, dark = (Sky(np.full((6, 8, 8, 3), value, np.float32)) for value in (0.9, 0.1))
    saw, blind = np.zeros((6, 8, 8), np.float32), np.zeros((6, 8, 8), np.float32)
    saw[4, :4], blind[4, 4:] = 1, 1
    joined = join_skies([SeenSky(bright, SkyEvidence(saw)), SeenSky(dark, SkyEvidence(blind))])
    np.testing.assert_allclose(joined.faces[4, :4], 0.9, atol=0.01)
    np.testing.assert_allclose(joined.faces[4, 4:], 0.1, atol=0.01)
    assert join_skies([]) is None


def test_without_instances_a_joined_scene_has_none():
    scenes = [piece_scene(piece) for piece in PIECES]
    scenes = [
        replace(scene, instance_ids=np.zeros(len(scene), np.uint32), table=type(scene.table)()) for scene in scenes
    ]
    joined = join(*scenes)
    assert not joined.instance_ids.any()
    assert joined.code_bits == 0


@pytest.mark.parametrize("piece", PIECES)
def test_a_piece_of_a_clip_has_its_own_photos_and_whole_tracks(piece):
    part = cut_clip(clip(), piece)
    assert [frame.view.index for frame in part.frames] == list(range(piece.first, piece.last + 1))
    assert len(part.tracks[0].times) == STEPS
    assert [step.photos for step in list_steps(part)].count(0) == 1
