"""What the editor shows of a recoloured car is what another program draws from the exported file, from two sides."""

import numpy as np
import pytest
from ply_painter import painted
from plyfile import PlyData
from procedural_street import FIRST_CAR, procedural_street

from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.state import EditorState, Intrinsics, Viewpoint, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.camera import look_at

CAR = (FIRST_CAR,)
CENTER = np.array([-3.0, 4.0, 0.8])
SIZE = (120, 80)
SIDES = {"from behind": (0.5, -3.0, 1.4), "from ahead": (-1.6, 8.6, 1.3)}
EDITS = {
    "tint": [RecolorInstances(CAR, "tint", (0.1, 0.3, 0.8))],
    "hue": [RecolorInstances(CAR, "hue", (0.1, 0.7, 0.2))],
    "solid": [RecolorInstances(CAR, "solid", (0.9, 0.8, 0.1))],
    "sliders": [
        SetAdjustment(CAR, what, amount)
        for what, amount in {"hue": 150.0, "saturation": 1.3, "temperature": -0.4, "contrast": 1.3}.items()
    ],
    "see-through tint": [
        RecolorInstances(CAR, "tint", (0.1, 0.8, 0.3)),
        SetAdjustment(CAR, "opacity", 0.6),
        SetAdjustment(CAR, "brightness", 1.4),
    ],
}
TOLERANCE = 1.0 / 255
"""Largest mean difference of two pictures of the car; right before the camera renderers cut splats differently."""


def glossy_street():
    """The street, with a car whose colours change much with the side that it is seen from."""
    scene = procedural_street(0.3)
    rows = np.flatnonzero(scene.instance_ids == FIRST_CAR)
    gloss = np.array([[0.25, 0.05, -0.1], [0.1, -0.2, 0.05], [-0.1, 0.2, 0.25]], np.float32)
    scene.gaussians.sh_rest[rows] += gloss
    return scene


def frame_from(place):
    pose = look_at(np.array(place), CENTER)
    lens = Intrinsics(90.0, 90.0, SIZE[0] / 2, SIZE[1] / 2, *SIZE)
    return resolve(EditorState(viewpoint=Viewpoint(pose, lens), show_sky=False, show_outlines=False), *SIZE)


def editor_picture(gl, document, snapshot):
    renderer = GlRenderer(gl, document)
    renderer.render(snapshot)
    blended = renderer.read_blended()
    car = renderer.read_instance_ids(snapshot) == FIRST_CAR
    renderer.release()
    return blended[..., :3], car


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS.keys())
def test_another_program_shows_the_exported_car_as_the_editor_does(gl, tmp_path, edits):
    document, before = Document(glossy_street()), Document(glossy_street())
    for edit in edits:
        document.apply(edit)
    exported, trained = tmp_path / "edited.ply", tmp_path / "trained.ply"
    save_scene(exported, bake_document(document, 0.0))
    save_scene(trained, bake_document(before, 0.0))
    old_rest = rest_columns(trained)
    for side, place in SIDES.items():
        snapshot = frame_from(place)
        lens = snapshot.camera
        camera = (lens.world_from_camera, lens.fx, lens.fy, *SIZE)
        shown, car = editor_picture(gl, document, snapshot)
        assert car.mean() > 0.05, side
        drawn, _ = painted(exported, *camera)
        assert np.abs(drawn - shown)[car].mean() < TOLERANCE, side
        untouched, _ = painted(trained, *camera)
        assert np.abs(drawn - untouched)[car].mean() > 20 * TOLERANCE, f"{side}: the edit is hardly seen"
        unfollowed, _ = painted(exported, *camera, replaced=old_rest)
        assert np.abs(unfollowed - shown)[car].mean() > 4 * TOLERANCE, f"{side}: the test would not notice a wrong rest"


def rest_columns(path):
    vertices = PlyData.read(path)["vertex"].data
    return {name: np.asarray(vertices[name], float) for name in vertices.dtype.names if name.startswith("f_rest_")}
