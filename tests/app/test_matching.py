"""Finding commands by a few letters."""

import pytest

from instdrive_app.matching import best_matches, match_score


@pytest.mark.parametrize(
    ("typed", "title"), [("exp", "Export…"), ("sbc", "Split by component"), ("", "x"), ("E X", "Export")]
)
def test_letters_in_order_match(typed, title):
    assert match_score(typed, title) is not None


@pytest.mark.parametrize(("typed", "title"), [("xe", "Export"), ("q", "Export"), ("exportt", "Export")])
def test_other_letters_do_not(typed, title):
    assert match_score(typed, title) is None


def test_word_starts_and_runs_come_first():
    titles = ["Select nothing", "Sort by name", "Show everything", "Split by component", "Subcode"]
    assert best_matches("sbc", titles, str)[0] == "Split by component"
    assert best_matches("sel", titles, str)[0] == "Select nothing"
    assert best_matches("", titles, str) == titles
    assert best_matches("zzz", titles, str) == []
