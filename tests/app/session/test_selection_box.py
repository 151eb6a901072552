"""Boxes of what is selected: kept from frame to frame, and never out of date."""

import numpy as np

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
