"""A view and a picker that followed hundreds of random edits, undos and jumps in time show what fresh ones would."""

import numpy as np
import pytest
from procedural_street import procedural_street
from random_scene import random_scene

from instdrive_app import camera
from instdrive_app.render.gl import gpu_scene
from instdrive_app.render.gl.gl_objects import count_live_objects
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.picking import Picker
from instdrive_app.state import EditorState, resolve
from instdrive_core.edits.bases.adjustments import RANGES
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.kinds.visibility import HideInstances, ShowAll
from instdrive_core.errors import EditError

SIZE = (120, 72)


def random_edit(rng, document):
    """Any kind, on one or two instances of which something is left."""
    alive = [number for number in document.find_visible_instances() if document.scene.table[number].count]
    ids = tuple(rng.choice(alive, min(len(alive), int(rng.integers(1, 3))), replace=False).tolist())
    shift = tuple(rng.normal(0, 1.5, 3).tolist())
    turn = tuple((np.array([1.0, 0, 0, 0]) + rng.normal(0, 0.4, 4)).tolist())
    kinds = [
        lambda: MoveInstances(ids, shift, rotation=turn, scale=float(rng.uniform(0.6, 1.6))),
        lambda: DuplicateInstances(ids, shift),
        lambda: InsertScene("other.ply", shift),
        lambda: AdjustInstances(ids, str(rng.choice(list(RANGES))), float(rng.uniform(0.2, 0.9))),
        lambda: RecolorInstances(ids, "tint", tuple(rng.random(3).tolist())),
        lambda: HideInstances(ids[:1]),
        ShowAll,
        lambda: DeleteInstances(ids[:1]),
        lambda: MergeInstances(ids[:1], ids[-1]),
        lambda: SelectInstances(ids),
        lambda: ReassignSelected(None),
        lambda: SplitInstance(ids[0]),
    ]
    return kinds[int(rng.integers(len(kinds)))]()


def step(rng, document, state):
    """An edit, an undo, a redo or another time."""
    choice = rng.random()
    if choice < 0.2:
        document.undo()
    elif choice < 0.3:
        document.redo()
    elif choice < 0.4:
        state.time = float(rng.uniform(-1, 5))
    elif len(document.find_visible_instances()):
        try:
            document.apply(random_edit(rng, document))
        except EditError:
            return  # not every edit fits every scene, and then nothing has changed


def list_shown_and_gone(gl):
    """The driver keeps the program used last until the next one: make it the same one each time."""
    document = Document(procedural_street(spacing=0.6))
    renderer = GlRenderer(gl, document)
    renderer.render(resolve(EditorState(viewpoint=camera.view_from_camera(document.scene.views[0])), *SIZE))
    renderer.release()


@pytest.mark.parametrize("seed", range(3))
def test_following_is_as_good_as_starting_afresh(gl, monkeypatch, seed):
    monkeypatch.setattr(gpu_scene, "UPLOADED_AT_ONCE", 700)
    rng = np.random.default_rng(seed)
    document = Document(procedural_street(spacing=0.6))
    document.open_scene = lambda path: random_scene(count=60, degree=1, seed=3)
    state = EditorState(viewpoint=camera.view_from_camera(document.scene.views[0]))
    list_shown_and_gone(gl)
    alive = count_live_objects()
    renderer, picker = GlRenderer(gl, document), Picker()
    for number in range(120):
        step(rng, document, state)
        snapshot = resolve(state, *SIZE)
        if rng.random() < 0.7:
            renderer.render(snapshot, wait=bool(rng.random() < 0.3))
        if number % 12 != 11:
            continue
        fresh, places = GlRenderer(gl, document), rng.integers(0, SIZE, (5, 2)).tolist()
        for one in (renderer, fresh):
            one.render(snapshot)
        np.testing.assert_array_equal(renderer.read_blended(), fresh.read_blended())
        np.testing.assert_array_equal(renderer.read_instance_ids(snapshot), fresh.read_instance_ids(snapshot))
        fresh.release()
        for x, y in places:
            assert picker.find_instances_at(document, snapshot, x, y) == Picker().find_instances_at(
                document, snapshot, x, y
            )
    assert document.versions.rows > 5
    renderer.release()
    assert gl.error == "GL_NO_ERROR"
    list_shown_and_gone(gl)
    assert count_live_objects() == alive
