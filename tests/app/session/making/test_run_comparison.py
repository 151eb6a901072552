"""Measured runs side by side in the editor."""

import json

import pytest
from session_driver import errors, finish

from instdrive_app.session.making import run_comparison
from instdrive_app.session.making.child import CommandFailedError


@pytest.fixture
def comparison(session, tmp_path):
    """A session's comparison that knows two finished runs and one that is not."""
    session.files.recents.clear()
    session.making.known.clear()
    for name in ("first", "second", "unfinished"):
        (tmp_path / name).mkdir()
        session.making.known.add(tmp_path / name)
    for name in ("first", "second"):
        (tmp_path / name / "run.json").write_text("{}")
    yield session.comparison
    session.making.known.clear()


def answer(monkeypatch, commands):
    def run(*arguments):
        commands.append(arguments)
        cells = [{"text": "21.0", "delta": "", "best": False}, {"text": "22.5", "delta": "+1.5", "best": True}]
        with open(arguments[-1], "w") as file:
            json.dump(
                {"names": ["second", "first"], "rows": [{"title": "PSNR", "cells": cells}], "notes": ["clips differ"]},
                file,
            )
        return ""

    monkeypatch.setattr(run_comparison, "run_command", run)


def test_finished_runs_are_listed(comparison, tmp_path):
    assert comparison.list_runs() == (tmp_path / "second", tmp_path / "first")


def test_the_chosen_runs_are_compared(session, comparison, tmp_path, monkeypatch):
    commands = []
    answer(monkeypatch, commands)
    comparison.compare()
    assert commands == []
    comparison.chosen = set(comparison.list_runs())
    comparison.compare()
    assert comparison.is_busy
    finish(session)
    assert commands[0][:4] == ("compare", str(tmp_path / "second"), str(tmp_path / "first"), "--json")
    assert comparison.table.names == ("second", "first")
    assert comparison.table.notes == ("clips differ",)
    ((title, cells),) = comparison.table.rows
    assert (title, [cell.text for cell in cells], [cell.best for cell in cells]) == (
        "PSNR",
        ["21.0", "22.5"],
        [False, True],
    )
    assert not comparison.is_busy


def test_a_comparison_that_fails_is_told_and_can_be_tried_again(session, comparison, monkeypatch):
    def fail(*arguments):
        raise CommandFailedError("first: its clip has moved")

    monkeypatch.setattr(run_comparison, "run_command", fail)
    comparison.chosen = set(comparison.list_runs())
    comparison.compare()
    finish(session)
    assert "its clip has moved" in errors(session)[0]
    assert not comparison.is_busy
