"""Which instances the list shows, and that it is worked out only where something has changed."""

import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, HOUSES, ROAD

from instdrive_app.panels.instances.rows import InstanceRows, Query, build_natural_key, matches
from instdrive_core.edits.kinds.classes import SetInstanceClass
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances
from instdrive_core.instances.table import Instance

CARS = tuple(range(FIRST_CAR, FIRST_CAR + 5))


def list_names(document, **query):
    rows = InstanceRows()
    rows.update(document, Query(**query))
    return rows.ids


def test_search_and_class_and_their_counts(street):
    rows = InstanceRows()
    rows.update(street, Query(search="LEFT pave"))
    assert rows.ids == (3,)
    rows.update(street, Query(class_name="Car"))
    assert rows.ids == (*CARS, DRIVING_CAR)
    assert rows.place[DRIVING_CAR] == 5
    assert rows.total == 15
    assert rows.classes == (("Car", 6), ("Houses", 2), ("Pavement", 2), ("Road", 1), ("Tree", 4))
    street.apply(SetInstanceClass(ROAD, ""))
    rows.update(street, Query(class_name=""))
    assert rows.ids == (ROAD,)
    assert rows.classes[-1] == ("", 1), "unknown last"


def test_every_column_sorts_both_ways(street):
    street.apply(HideInstances((30,)))
    street.apply(LockInstances((31,)))
    for column in ("#", "Code", "Name", "Class", "Splats", "Shown", "Locked"):
        up, down = (list_names(street, column=column, descending=descending) for descending in (False, True))
        assert sorted(up) == sorted(down) == list(list_names(street))
        assert up[0] != down[0], column
    assert list_names(street, column="Splats", descending=True)[0] == ROAD
    assert list_names(street, column="Shown")[-1] == 30
    assert list_names(street, column="Locked")[0] == 31


def test_names_are_sorted_as_people_count(street):
    street.apply(RenameInstance(FIRST_CAR, "car 10"))
    street.apply(RenameInstance(FIRST_CAR + 1, "car 9"))
    assert list_names(street, column="Name", search="car 10")[0] == FIRST_CAR
    assert list_names(street, column="Name")[:2] == (FIRST_CAR + 1, FIRST_CAR)
    assert build_natural_key("x") < build_natural_key("x 2") < build_natural_key("x 10")


@pytest.mark.parametrize("edit", [DeleteInstances((HOUSES,)), RenameInstance(HOUSES, "a barn")])
def test_what_changes_the_list_is_seen_and_undone(street, edit):
    rows = InstanceRows()
    rows.update(street, Query(column="Name"))
    before = rows.ids
    street.apply(edit)
    rows.update(street, Query(column="Name"))
    assert rows.ids != before
    street.undo()
    rows.update(street, Query(column="Name"))
    assert rows.ids == before


def test_nothing_is_sorted_again_for_a_selection(street, monkeypatch):
    rows = InstanceRows()
    rows.update(street, Query())
    monkeypatch.setattr(rows, "_sort", lambda query: pytest.fail("sorted again"))
    rows.update(street, Query())
    street.apply(SelectInstances((FIRST_CAR,)))
    rows.update(street, Query())
    monkeypatch.undo()
    street.apply(DeleteInstances((FIRST_CAR,)))
    rows.update(street, Query())
    assert FIRST_CAR not in rows.place


@pytest.mark.parametrize(
    ("search", "found"), [("", True), ("CAR", True), ("17", True), ("red car", True), ("tree", False)]
)
def test_search_takes_every_word(search, found):
    assert matches(Instance(17, "red taxi", class_name="Car"), search.lower().split()) is found
