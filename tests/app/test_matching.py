"""Finding commands by a few letters."""

import pytest

from instdrive_app.matching import find_best_matches, score_match


@pytest.mark.parametrize(
    ("typed", "title"), [("exp", "Export…"), ("sbc", "Split by component"), ("", "x"), ("E X", "Export")]
)
def test_letters_in_order_match(typed, title):
    assert score_match(typed, title) is not None


@pytest.mark.parametrize(("typed", "title"), [("xe", "Export"), ("q", "Export"), ("exportt", "Export")])
def test_other_letters_do_not(typed, title):
    assert score_match(typed, title) is None


def test_word_starts_and_runs_come_first():
    titles = ["Select nothing", "Sort by name", "Show everything", "Split by component", "Subcode"]
    assert find_best_matches("sbc", titles, str)[0] == "Split by component"
    assert find_best_matches("sel", titles, str)[0] == "Select nothing"
    assert find_best_matches("", titles, str) == titles
    assert find_best_matches("zzz", titles, str) == []


def test_other_words_find_by_their_start_and_after_titles():
    words = {"Export…": ("screenshot", "picture"), "Show the pictures": (), "Play": ("video",)}
    assert find_best_matches("screens", words, str, words=words.get) == ["Export…"]
    assert find_best_matches("picture", words, str, words=words.get)[0] == "Show the pictures"
    assert "Export…" in find_best_matches("picture", words, str, words=words.get)
    assert "Export…" not in find_best_matches("shot", words, str, words=words.get)


def test_titles_come_before_groups_and_rows_of_letters_before_starts_of_words():
    menus = {"Absorb the shadow": "Deletion", "Delete": "Edit", "Rescue": "File", "Split by component": "Labels"}
    assert find_best_matches("delet", menus, str, menus.get)[:2] == ["Delete", "Absorb the shadow"]
    assert find_best_matches("sc", menus, str, menus.get)[0] == "Split by component"
