"""Label repair, locks, solo and colours through the session, as menus and panels do it."""

import numpy as np
from procedural_street import DRIVING_CAR, FIRST_CAR, HOUSES, ROAD, procedural_street
from session_driver import errors, finish

from instdrive_app.panels.menus import format_action_title
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.serialize import edits_from_lines, edits_to_lines

CARS = (FIRST_CAR, FIRST_CAR + 1)


def picture(document):
    """All that label repair may change."""
    table = {number: (i.name, i.class_name, i.count, i.bounds) for number, i in document.scene.table.instances.items()}
    return document.scene.instance_ids.tobytes(), table, document.state.flags.tobytes(), document.first_free_id


def undone_and_redone(document, before):
    after = picture(document)
    document.undo()
    assert picture(document) == before
    document.redo()
    assert picture(document) == after


def test_merge_takes_the_largest_or_the_one_named(session, street):
    count = {i: street.scene.table[i].count for i in (30, FIRST_CAR)}
    session.selection.select((30, FIRST_CAR))
    before = picture(street)
    assert session.actions.run("labels.merge")
    assert 30 not in street.scene.table
    assert street.scene.table[FIRST_CAR].count == count[30] + count[FIRST_CAR]
    assert session.selection.ids == (FIRST_CAR,)
    assert street.history.edits[-1].title == f"Merge instance 30 into instance {FIRST_CAR}"
    undone_and_redone(street, before)
    street.undo()
    session.labels.merge((30, FIRST_CAR), 30)
    assert FIRST_CAR not in street.scene.table
    session.selection.select((30,))
    assert not session.actions.run("labels.merge"), "one alone cannot be merged"


def test_things_that_move_differently_are_not_merged(session, street):
    steps = street.history.cursor
    session.labels.merge((FIRST_CAR, DRIVING_CAR))
    assert "moves with another object" in errors(session)[-1]
    assert street.history.cursor == steps


def test_split_gives_the_sizes_it_announced(session, street):
    session.labels.merge(CARS)
    into = FIRST_CAR
    sizes = SplitInstance(into, 1.0).prepare(street)
    assert len(sizes) == 2
    before = picture(street)
    session.labels.split(SplitInstance(into, 1.0))
    finish(session)
    new = street.first_free_id - 1
    assert (street.scene.table[into].count, street.scene.table[new].count) == sizes
    assert street.scene.table[new].class_name == "Car"
    assert "1 new instance" in session.messages.log[-1].text
    undone_and_redone(street, before)
    session.labels.split(SplitInstance(into, 1.0))
    finish(session)
    assert "smaller gap" in errors(session)[-1]


def test_reassign_selected_splats_to_another_a_new_one_or_none(session, street):
    rows = street.find_rows((FIRST_CAR,))[:100]
    session.history.apply(SelectRows(rows))
    before = picture(street)
    session.labels.reassign(FIRST_CAR + 1)
    assert (street.scene.instance_ids[rows] == FIRST_CAR + 1).all()
    undone_and_redone(street, before)
    assert session.actions.run("labels.new")
    new = street.first_free_id - 1
    assert street.scene.table[new].count == 100
    session.labels.reassign(0)
    assert new not in street.scene.table
    assert not street.scene.instance_ids[rows].any()
    assert not session.selection.is_empty
    assert session.actions.run("labels.new"), "splats without an instance can be given to one"
    session.selection.clear()
    assert not session.actions.run("labels.new")


def test_absorbing_floaters_takes_what_lies_inside(session, street):
    rows = street.find_rows((FIRST_CAR,))[::40]
    session.history.apply(SelectRows(rows))
    session.labels.reassign(0)
    before = picture(street)
    session.labels.absorb((FIRST_CAR,))
    assert picture(street) == before, "looked for beside the window"
    finish(session)
    assert (street.scene.instance_ids[rows] == FIRST_CAR).mean() > 0.8
    assert "floaters absorbed" in session.messages.log[-1].text
    undone_and_redone(street, before)
    session.labels.absorb((ROAD,))
    finish(session)
    assert "compact" in errors(session)[-1]
    assert errors(session)[-1].startswith("Instance")


def test_floaters_of_several_are_one_step_whatever_is_edited_meanwhile(session, street):
    rows = {car: street.find_rows((car,))[::40] for car in CARS}
    session.history.apply(SelectRows(np.concatenate(list(rows.values()))))
    session.labels.reassign(0)
    session.labels.absorb(CARS)
    session.visibility.lock((HOUSES,))
    before, steps = picture(street), street.history.cursor
    finish(session)
    for car in CARS:
        assert (street.scene.instance_ids[rows[car]] == car).mean() > 0.8
    assert street.history.cursor == steps + 1
    undone_and_redone(street, before)


def test_the_class_of_several_is_one_step(session, street):
    before = picture(street)
    session.labels.set_class(CARS, "Taxi")
    assert {street.scene.table[i].class_name for i in CARS} == {"Taxi"}
    assert "Taxi" in session.labels.list_classes()
    assert street.history.cursor == 1
    undone_and_redone(street, before)
    session.labels.set_class((FIRST_CAR,), "")
    assert street.scene.table[FIRST_CAR].class_name == ""
    session.selection.select_class("Taxi")
    assert session.selection.ids == (FIRST_CAR + 1,)


def test_repairs_are_replayed_from_their_parameters(session, street):
    fresh_street = Document(procedural_street())
    session.labels.merge(CARS)
    session.labels.split(SplitInstance(FIRST_CAR, 1.0))
    finish(session)
    session.labels.set_class((30, 31), "Bush")
    session.selection.select((30,))
    session.labels.reassign(31)
    session.visibility.solo.enter((31,))
    for edit in edits_from_lines(edits_to_lines(street.history.edits)):
        fresh_street.apply(edit)
    assert picture(fresh_street) == picture(street)


def test_locked_instances_are_neither_selected_nor_deleted(session, street):
    session.selection.select(CARS)
    assert session.actions.run("edit.lock")
    assert session.selection.ids == ()
    session.selection.select(CARS)
    assert session.selection.ids == ()
    session.deletion.delete((FIRST_CAR,))
    assert "unlock it first" in errors(session)[-1]
    assert session.visibility.locked_ids == CARS
    assert session.actions.run("edit.unlock_all")
    session.selection.select(CARS)
    assert session.selection.ids == CARS


def test_leaving_solo_brings_back_what_was_shown_before(session, street):
    session.visibility.hide((HOUSES,))
    before = street.find_visible_instances()
    session.visibility.solo.toggle((FIRST_CAR,))
    assert session.visibility.solo.ids == (FIRST_CAR,)
    session.visibility.solo.toggle(CARS)
    assert street.find_visible_instances() == CARS
    session.history.undo()
    session.history.undo()
    assert session.visibility.solo.ids == ()
    assert street.find_visible_instances() == before
    session.history.redo()
    session.history.redo()
    assert session.visibility.solo.ids == CARS
    session.visibility.solo.leave()
    assert street.find_visible_instances() == before
    assert session.visibility.solo.ids == ()


def test_deleting_what_is_shown_alone_leaves_the_way_back_to_the_rest(session, street):
    session.visibility.hide((HOUSES,))
    before = street.find_visible_instances()
    session.visibility.solo.enter((FIRST_CAR,))
    session.deletion.delete((FIRST_CAR,))
    assert street.find_visible_instances() == ()
    assert session.visibility.solo.ids == (FIRST_CAR,)
    assert session.actions.run("edit.solo")
    assert street.find_visible_instances() == tuple(i for i in before if i != FIRST_CAR)
    session.history.jump(1)
    session.visibility.hide(before)
    assert session.visibility.solo.ids == (), "the solo was undone: what is hidden was hidden by hand"


def test_solo_hides_splats_of_no_instance_and_shows_what_was_hidden(session, street):
    rows = street.find_rows((30,))
    session.selection.select((30,))
    session.labels.reassign(0)
    session.visibility.hide((FIRST_CAR,))
    session.visibility.solo.enter((FIRST_CAR,))
    assert not street.state.drawn[rows].any()
    assert street.find_visible_instances() == (FIRST_CAR,)
    session.visibility.solo.leave()
    assert street.state.drawn[rows].all()
    assert FIRST_CAR not in street.find_visible_instances()


def test_a_drag_of_a_slider_is_one_step_and_reset_is_another(session, street):
    for amount in (0.8, 0.5, 1.4):
        session.colors.adjust(CARS, "brightness", amount, "drag 1")
    assert street.history.cursor == 1
    assert street.history.edits[-1].title == "Set brightness of 2 instances to 1.4"
    session.selection.select((FIRST_CAR,))
    assert session.actions.run("edit.reset_colors")
    assert not street.colors.indices[street.find_rows((FIRST_CAR,))].any()
    assert street.colors.indices[street.find_rows((FIRST_CAR + 1,))].all()


def test_what_commands_change_is_said_by_the_commands(session, street):
    """Whatever a command without `undoable` does, the history does not grow."""
    session.selection.select((FIRST_CAR,))
    for command in session.actions:
        if command.menu in ("Edit", "Labels", "Select") and command.id not in (
            "edit.undo",
            "edit.redo",
            "edit.preferences",
        ):
            assert command.undoable is not None, command.id
    assert format_action_title(session.actions["file.export"]) == "Export…  (cannot be undone)"
    assert format_action_title(session.actions["edit.delete"]) == "Delete"
    steps = street.history.cursor
    for command in session.actions:
        if command.undoable is None and command.menu in ("View", "Time"):
            session.actions.run(command.id)
    assert street.history.cursor == steps
    assert np.array_equal(session.selection.ids, (FIRST_CAR,))
