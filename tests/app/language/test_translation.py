"""Texts are said in the language that is spoken, and stay English where nothing is known."""

import pytest

from instdrive_app.action import format_shortcut
from instdrive_app.language.languages import find_system_language, resolve_language
from instdrive_app.language.translation import get_language, make_label, speak, translate
from instdrive_core.wording import begin_sentence, count_phrase, drop_ellipsis, format_count, phrase


@pytest.fixture
def german():
    """The window speaks German during the test."""
    speak("de")
    yield
    speak("en")


def test_english_is_what_the_sources_say():
    assert get_language() == "en"
    assert translate("Undo") == "Undo"
    assert translate("{command}: {reason}", command="A", reason="b") == "A: b"
    assert make_label("Undo") == "Undo###Undo"


def test_a_phrase_is_an_english_text_that_can_be_said_again(german):
    said = phrase("“{job}” is still running", job=phrase("Undo"))
    assert said == "“Undo” is still running"
    assert translate(said) == "„Rückgängig“ läuft noch"
    assert make_label("Undo") == "Rückgängig###Undo"
    assert make_label("Undo", "edit.undo") == "Rückgängig###edit.undo"


def test_names_given_by_users_are_not_translated(german):
    assert translate("“{job}” is still running", job="Undo") == "„Undo“ läuft noch"
    assert translate("nowhere in the catalogue") == "nowhere in the catalogue"
    assert translate("") == ""


def test_endings_and_capitals_are_changed_after_the_translation(german):
    assert drop_ellipsis("Open…") == "Open"
    assert translate(drop_ellipsis("Open…")).rstrip() == "Öffnen"
    assert begin_sentence("nothing needs to change") == "Nothing needs to change"
    assert translate(begin_sentence("nothing needs to change")) == "Es ist nichts zu ändern"


def test_counts_have_their_plurals_and_thousands_their_gap(german):
    assert format_count(1, "splat") == "1 splat"
    assert count_phrase(2, "{count} box of {name}", "{count} boxes of {name}", name="A") == "2 boxes of A"
    assert translate("{count:,}", count=1234567) == "1\N{NARROW NO-BREAK SPACE}234\N{NARROW NO-BREAK SPACE}567"
    assert format_shortcut("Ctrl+Shift+Delete") == "Strg+Umschalt+Entf"


@pytest.mark.parametrize(
    ("environment", "code"),
    [
        ({"LANG": "de_DE.UTF-8"}, "de"),
        ({"LANG": "de_AT", "LC_ALL": "en_US.UTF-8"}, "en"),
        ({"LANGUAGE": "fr:de", "LANG": "en_US"}, "de"),
        ({"LC_MESSAGES": "fr_FR"}, "en"),
        ({"LANG": "C.UTF-8"}, "en"),
        ({}, "en"),
    ],
)
def test_the_desktop_names_the_language(environment, code):
    assert find_system_language(environment) == code
    assert resolve_language("de") == "de"
