"""Boxes of what is selected: kept from frame to frame, and never out of date."""

import numpy as np
from procedural_street import FIRST_CAR

from instdrive_app.session.selection_box import SelectionBoxes
from instdrive_core.edits.kinds.move import MoveInstances


def test_the_box_of_several_instances_is_kept_until_something_moves(street, monkeypatch):
    made = []
    level_box = SelectionBoxes._find_level_box
    monkeypatch.setattr(SelectionBoxes, "_find_level_box", lambda *given: made.append(1) or level_box(*given))
    boxes = SelectionBoxes()
    parked = tuple(i.id for i in street.scene.table if not i.node)[:3]
    before = boxes.find_box(street, parked, 0.0)
    assert boxes.find_box(street, parked, 0.0) is before
    street.apply(MoveInstances(parked, (1.0, 2.0, 0.0)))
    np.testing.assert_allclose(boxes.find_box(street, parked, 0.0).center - before.center, [1, 2, 0], atol=1e-4)
    street.undo()
    np.testing.assert_allclose(boxes.find_box(street, parked, 0.0).center, before.center, atol=1e-6)
    boxes.find_box(street, parked[:2], 0.0)
    boxes.find_box(street, parked[:2], 0.5)
    assert len(made) == 5


def test_splats_below_the_road_are_no_part_of_a_parked_cars_box(street):
    trained = SelectionBoxes().find_box(street, (FIRST_CAR,), 0.0)
    rows = street.find_rows((FIRST_CAR,))
    means = street.scene.gaussians.means
    rng = np.random.default_rng(0)
    low, high = means[rows].min(axis=0), means[rows].max(axis=0)
    strays = rows[rng.choice(len(rows), len(rows) // 20, replace=False)]
    means[strays] = rng.uniform(low - 4, high + np.array([4, 4, -1]), (len(strays), 3))
    found = SelectionBoxes().find_box(street, (FIRST_CAR,), 0.0)
    np.testing.assert_allclose(found.size, trained.size, atol=0.5)
    np.testing.assert_allclose(found.center, trained.center, atol=0.3)
