"""Blocks of splats that a view cannot show are left out of OpenGL's frames, which stay as they were."""

import time
from dataclasses import replace

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street

from instdrive_app.camera import view_from_camera
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.splat_blocks import BLOCK, SplatBlocks, SplatPlaces, list_move_scales
from instdrive_app.render.view_cone import widen_view
from instdrive_app.render.world_means import WorldMeans
from instdrive_app.state import EditorState, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera, look_at

SIZE = (240, 144)


def turned(camera, degrees, way=(0.0, 0.0, 0.0)):
    pose = camera.world_from_camera.copy()
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    pose[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose[:3, :3]
    pose[:3, 3] += way
    return replace(camera, world_from_camera=pose)


def find_places(document):
    scene = document.scene
    scales = list_move_scales(document.transforms.matrices)
    world, moves = WorldMeans(document), document.transforms.indices
    world.update(0.0)
    return SplatPlaces(world.values, scene.gaussians.log_scales, moves, scales, scene.nodes, scene.instance_ids)


def test_a_cone_covers_small_moves_and_no_large_ones():
    camera = Camera(200.0, 200.0, 120.0, 72.0, *SIZE, look_at(np.array([1.0, -8.0, 3.0]), np.array([0.0, 0.0, 1.0])))
    cone = widen_view(camera)
    assert cone.covers(camera)
    assert cone.covers(turned(camera, 2.0, (0.1, 0.0, -0.05)))
    assert cone.covers(turned(camera, 0.0, tuple(-0.5 * camera.world_from_camera[:3, 2])))
    assert not cone.covers(turned(camera, 25.0))
    assert not cone.covers(turned(camera, 0.0, tuple(-3.0 * camera.world_from_camera[:3, 2])))
    assert not cone.covers(replace(camera, fx=100.0, fy=100.0)), "it sees more"


@pytest.mark.parametrize("degrees", [60.0, 110.0, 160.0])
def test_what_is_left_out_shows_nowhere(degrees):
    document = Document(procedural_street())
    camera = turned(document.scene.views[0].camera.resize(*SIZE), degrees)
    places = find_places(document)
    blocks = SplatBlocks(places)
    blocks.update(places, 1)
    inside = blocks.find_inside(widen_view(camera))
    assert 0 < inside.sum() < len(inside) - 2 * BLOCK
    whole, part = view_scene(document.scene, camera, 0.0), view_scene(document.scene, camera, 0.0, inside)
    np.testing.assert_array_equal(part.color, whole.color)
    np.testing.assert_array_equal(part.winner, whole.winner)


def test_what_is_not_finite_is_left_out_and_hides_no_neighbour():
    document = Document(procedural_street())
    document.scene.gaussians.means[::50] = np.nan
    places = find_places(document)
    blocks = SplatBlocks(places)
    blocks.update(places, 1)
    camera = document.scene.views[0].camera
    pixels, depths = camera.project(places.means.astype(np.float64))
    seen = (depths > 0.2) & (pixels > 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1)
    assert blocks.find_inside(widen_view(camera))[seen].all()


@pytest.fixture
def renderer(gl, street):
    made = GlRenderer(gl, street)
    yield made
    made.release()
    assert gl.error == "GL_NO_ERROR"


def settle(renderer, snapshot):
    end = time.monotonic() + 120
    renderer.render(snapshot, wait=False)
    while not renderer.settled:
        assert time.monotonic() < end
        time.sleep(0.002)
        renderer.render(snapshot, wait=False)
    return renderer.read_blended()


def settle_culled(renderer, snapshot, count):
    """Look about until the splats are in blocks and fewer than `count`, those before the camera, are drawn."""
    for number in range(2000):
        settle(renderer, replace(snapshot, camera=turned(snapshot.camera, 10 + number % 2)))
        blended = settle(renderer, snapshot)
        if renderer._projector.count < count:
            return blended
    raise AssertionError("nothing is ever left out")


def test_frames_without_what_is_out_of_view_are_the_same(gl, street, renderer):
    view = street.scene.views[0]
    snapshot = resolve(EditorState(viewpoint=view_from_camera(view)), *SIZE)
    snapshot = replace(snapshot, camera=turned(snapshot.camera, 90.0))
    renderer.render(snapshot)
    whole, count = renderer.read_blended(), renderer._projector.count
    np.testing.assert_array_equal(settle_culled(renderer, snapshot, count), whole)
    moving = replace(snapshot, camera=turned(snapshot.camera, 0.2))
    renderer.render(moving, wait=False)
    assert renderer._projector.count < count, "a small turn shows nothing that was left out"
    renderer.render(replace(snapshot, camera=turned(snapshot.camera, 120.0)), wait=False)
    assert renderer._projector.count == len(renderer.scene), "who turns far sees all at once, if not in order"

    settle(renderer, snapshot)
    street.apply(MoveInstances((FIRST_CAR,), (6.0, 6.0, 0.0)))
    moved = settle(renderer, snapshot)
    fresh = GlRenderer(gl, street)
    fresh.render(snapshot)
    np.testing.assert_array_equal(moved, fresh.read_blended())
    fresh.release()
