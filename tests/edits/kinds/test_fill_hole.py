"""Filled holes look like the street they are in, are marked, and vanish with undo."""

import json
from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, KERB, parked_street
from random_scene import assert_same_scene

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import CONTENT, fingerprint
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.inpainting import choose_source_cells
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.edits.kinds.light.cast_shadows import find_put
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.selection import Flag


def emptied(street):
    """The street with the car and its strays deleted, and the report of that."""
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    document.apply(AbsorbFloaters(CAR))
    return document, report_deletion(document, (CAR,), 0.0)


def psnr(scene, truth, mask, camera):
    difference = view_scene(scene, camera, 0.0).color - view_scene(truth, camera, 0.0).color
    return -10 * np.log10(np.mean(difference[mask] ** 2))


def place_of_car(camera):
    """Mask of the pixels that show the ground where the car stood."""
    along = np.linspace(-0.5, 0.5, 60)
    x, y = np.meshgrid(CAR_CENTER[0] + CAR_SIZE[0] * along, CAR_CENTER[1] + CAR_SIZE[1] * along)
    points = np.stack([x, y, 0.02 * y], axis=-1).reshape(-1, 3)
    pixels, _ = camera.project(points)
    mask = np.zeros((camera.height, camera.width), bool)
    columns, rows = np.floor(pixels).astype(int).T
    seen = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    mask[rows[seen], columns[seen]] = True
    return mask


@pytest.fixture(scope="module")
def street():
    return parked_street()


@pytest.mark.parametrize("eye", [(-2.0, -4.0, 1.7), (-2.5, 1.0, 2.0), (1.0, -7.0, 2.5)])
def test_the_filled_street_looks_like_the_street_without_the_car(street, eye):
    document, report = emptied(street)
    camera = Camera(260.0, 260.0, 160.0, 100.0, 320, 200, look_at(np.array(eye), CAR_CENTER - [0, 0, 0.7]))
    mask = place_of_car(camera)
    assert mask.sum() > 500
    before = psnr(bake_document(document), street.empty, mask, camera)
    document.apply(report.make_fill_edits()[0])
    after = psnr(bake_document(document), street.empty, mask, camera)
    assert after > 28, (before, after)
    assert before < 15, (before, after)
    assert find_put(document.history.done[-1]).ids == (), "ground gets no shadow, and is in nothing's way"


def test_copies_lie_on_the_ground_in_its_colours(street):
    document, report = emptied(street)
    count = len(document.scene)
    document.apply(report.make_fill_edits()[0])
    fill = document.scene.table[int(document.scene.instance_ids[count])]
    assert (fill.name, fill.class_name, fill.count) == ("fill of Car 7", "synthetic", len(document.scene) - count)
    rows = np.arange(count, len(document.scene))
    means, colors = document.compute_means(rows), color_from_dc(document.scene.gaussians.sh_dc[rows])
    heights = means[:, 2] - 0.02 * means[:, 1]
    low = heights < 0.3  # the wall behind was hidden, too
    road, pavement = low & (means[:, 0] < 2.9), low & (means[:, 0] > 3.1)
    assert abs(np.median(heights[road])) < 0.03
    if pavement.any():
        assert abs(np.median(heights[pavement]) - KERB) < 0.05
    np.testing.assert_allclose(np.median(colors[road], axis=0), [0.33, 0.33, 0.35], atol=0.04)
    left = report_deletion(document, (CAR,), 0.0).hole_area
    assert left < 0.05 * report.hole_area, "nothing much is left to be filled"


def test_copies_are_marked_also_in_files(street, tmp_path):
    document, report = emptied(street)
    count = len(document.scene)
    document.apply(report.make_fill_edits()[0])
    column = document.scene.extra["synthetic"]
    assert not column[:count].any()
    assert column[count:].all()
    for name in ("filled.ply", "filled"):
        save_scene(tmp_path / name, bake_document(document))
        again = open_scene(tmp_path / name)
        assert again.extra["synthetic"].sum() == len(column) - count
    fill = next(entry for entry in again.table if entry.class_name == "synthetic")
    assert fill.count == len(column) - count


def test_undo_takes_everything_back_and_a_replay_does_the_same(street):
    document, report = emptied(street)
    same, _ = emptied(street)
    state = same.state.flags.copy(), same.first_free_id
    edit = report.make_fill_edits(seed=3)[0]
    document.apply(edit)
    assert document.state.find_mask(Flag.DELETED).sum() > (state[0] & Flag.DELETED > 0).sum(), "noise in the hole goes"
    replayed, _ = emptied(street)
    replayed.apply(edit_from_json(json.loads(json.dumps(edit.to_json()))))
    assert_same_scene(replayed.scene, document.scene)
    np.testing.assert_array_equal(replayed.state.flags, document.state.flags)
    filled = document.scene.gaussians.means.copy()
    document.undo()
    assert_same_scene(document.scene, same.scene)
    np.testing.assert_array_equal(document.state.flags, state[0])
    assert document.first_free_id == state[1]
    assert "synthetic" not in document.scene.extra
    document.redo()
    np.testing.assert_array_equal(document.scene.gaussians.means, filled)


def test_a_second_fill_keeps_the_column_of_the_first(street):
    document, report = emptied(street)
    first = report.make_fill_edits()[0]
    document.apply(first)
    count = len(document.scene)
    document.apply(report.make_fill_edits(seed=1)[0])
    assert document.scene.extra["synthetic"][count:].all()
    document.undo()
    assert len(document.scene.extra["synthetic"]) == count
    document.undo()
    assert "synthetic" not in document.scene.extra


def test_copies_wear_the_colour_of_recoloured_ground(street):
    document, report = emptied(street)
    document.apply(RecolorInstances((1,), "solid", (0.0, 0.0, 1.0)))
    count = len(document.scene)
    document.apply(report.make_fill_edits()[0])
    means, entries = document.scene.gaussians.means[count:], document.colors.indices[count:]
    road = (means[:, 0] < 2.9) & (means[:, 2] < 0.15)
    copied = np.isin(entries, np.unique(document.colors.indices[document.find_rows((1,))]))
    assert copied[road].mean() > 0.9
    assert copied[~road].mean() < 0.1


def test_a_fill_without_ground_around_is_refused(street):
    document, report = emptied(street)
    document.apply(DeleteInstances((1, 2, 3)))
    count = len(document.scene)
    with pytest.raises(EditError, match="no ground"):
        document.apply(report.make_fill_edits()[0])
    assert len(document.scene) == count
    assert "synthetic" not in document.scene.extra


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cells": ()}, "without cells"),
        ({"cells": ((1, 2, 3),)}, "two whole numbers"),
        ({"cells": ((1.5, 2),)}, "two whole numbers"),
        ({"along": (2.0, 0.0)}, "unit vector"),
        ({"size": 0.0}, "size"),
        ({"plane": (0.0, float("nan"), 0.0)}, "plane"),
        ({"name": ""}, "name"),
        ({"seed": -1}, "seed"),
        ({"seed": True}, "seed"),
    ],
)
def test_wrong_parameters_are_refused(change, message):
    good = {"cells": ((0, 0),), "corner": (0.0, 0.0), "along": (0.0, 1.0), "size": 0.2, "plane": (0.0, 0.0, 0.0)}
    FillHole(**good)
    with pytest.raises(EditError, match=message):
        FillHole(**(good | change))


def test_pieces_continue_what_runs_along_the_lane():
    values = np.zeros((60, 30, 1))
    values[:, 12:15] = 1.0
    hole = np.zeros((60, 30), bool)
    hole[25:35, 8:20] = True
    known = ~hole
    sources = choose_source_cells(np.where(hole[..., None], 0.5, values), known, hole, np.random.default_rng(0))
    assert (sources[~hole] == -1).all()
    cells = sources[hole]
    assert known[tuple(cells.T)].all()
    np.testing.assert_array_equal(values[tuple(cells.T)], values[hole])
    assert choose_source_cells(values, np.zeros_like(known), hole, np.random.default_rng(0)) is None


def test_a_fill_prepared_beside_the_document_is_the_same_and_quick(street, monkeypatch):
    document, report = emptied(street)
    expected, _ = emptied(street)
    expected.apply(report.make_fill_edits()[0])
    frozen, edit = freeze_document(document), report.make_fill_edits()[0]
    document.apply(SelectInstances((1,)))
    edit.prepare(frozen)
    with monkeypatch.context() as patch:
        patch.setattr("instdrive_core.edits.kinds.fill_hole.plan_fill", None)
        document.apply(edit)
        document.undo()
        document.redo()
    np.testing.assert_array_equal(document.scene.gaussians.means, expected.scene.gaussians.means)
    late, _ = emptied(street)
    edit = report.make_fill_edits()[0]
    edit.prepare(freeze_document(late))
    late.apply(DeleteInstances((8,)))
    late.apply(edit)
    fresh, _ = emptied(street)
    fresh.apply(DeleteInstances((8,)))
    fresh.apply(report.make_fill_edits()[0])
    assert_same_scene(late.scene, fresh.scene)


def test_a_frozen_copy_does_not_follow_the_document(street):
    document, _ = emptied(street)
    document.apply(MoveInstances((8,), (1.0, 0.0, 0.0)))
    frozen, before = freeze_document(document), fingerprint(document, CONTENT)
    assert fingerprint(frozen, CONTENT) == before
    means = frozen.compute_means(frozen.find_rows((8,))).copy()
    document.apply(MoveInstances((8,), (0.0, 1.0, 0.0)))
    assert fingerprint(document, CONTENT) != before
    document.undo()
    assert fingerprint(document, CONTENT) == before
    document.apply(MergeInstances((1,), 2))
    document.apply(DeleteInstances((8,)))
    np.testing.assert_array_equal(frozen.compute_means(frozen.find_rows((8,))), means)
    assert frozen.summarize_instance(8).drawn == len(means)
    assert 1 in frozen.scene.table
    assert fingerprint(frozen, CONTENT) == before
