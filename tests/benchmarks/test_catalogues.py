"""The catalogues hold every text of the window, in every language, with what programs fill in."""

import ast
import re
import string
from collections import Counter

import pytest
from imgui_bundle import imgui

from benchmarks.catalogue import list_missing, read_catalogue, render_catalogue, update_catalogue
from benchmarks.ui_texts import ROOT, WORDS, list_ui_texts
from instdrive_app.actions import register_actions
from instdrive_app.language.languages import ENGLISH, LANGUAGES
from instdrive_app.language.translation import make_label, speak, translate
from instdrive_app.panels.registry import PANELS
from instdrive_app.panels.window_menu import list_panel_actions
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.window import make_window_name

FOREIGN = sorted(LANGUAGES.keys() - {ENGLISH})
PRINTF = re.compile(r"%[-+0-9.]*[a-z%]")
SHOWN_FIRST = ("text", "text_wrapped", "text_disabled", "set_tooltip", "set_item_tooltip", "separator_text", "button")
SHOWN_FIRST += ("small_button", "checkbox", "radio_button", "selectable", "menu_item", "begin_menu", "input_float")
SHOWN_FIRST += ("begin_popup_modal", "open_popup", "collapsing_header", "table_setup_column", "input_int", "begin")
"""Functions of ImGui whose first argument the user reads."""


@pytest.fixture(scope="module", params=FOREIGN)
def code(request):
    return request.param


@pytest.fixture(scope="module")
def catalogue(code):
    return read_catalogue(code)


@pytest.fixture
def spoken(code):
    speak(code)
    yield code
    speak(ENGLISH)


def list_pairs(catalogue):
    """Each English text with what is said instead."""
    for message in catalogue:
        if message.id:
            texts = message.id if isinstance(message.id, tuple) else (message.id,)
            said = message.string if isinstance(message.string, tuple) else (message.string,)
            for place, words in enumerate(said):
                yield texts[min(place, len(texts) - 1)], words


def find_fields(template):
    return Counter((name, spec.split("%")[0]) for _, name, spec, _ in string.Formatter().parse(template) if name)


def test_the_catalogue_has_exactly_the_texts_of_the_sources(code):
    for path, wanted in render_catalogue(update_catalogue(code), code).items():
        assert path.read_bytes() == wanted, f"{path.name} is out of date: run make catalogue"


def test_every_text_is_translated(catalogue):
    assert not list_missing(catalogue), "translate them in the .po file, then run make catalogue"
    assert not [message.id for message in catalogue if message.fuzzy]


def test_the_same_is_filled_in(catalogue):
    for text, said in list_pairs(catalogue):
        assert find_fields(said) == find_fields(text), f"{text!r} has other placeholders than {said!r}"
        numbers = text if not find_fields(text) else ""
        assert not numbers or PRINTF.findall(said) == PRINTF.findall(numbers), (
            f"{text!r} has other numbers than {said!r}"
        )


def test_translations_keep_what_frames_a_text(catalogue):
    for text, said in list_pairs(catalogue):
        assert said.endswith("…") == text.endswith("…"), said
        assert said.endswith(".") == text.endswith(".") or text.startswith("{number}"), said
        assert said.count("\n") == text.count("\n"), said
        assert said == said.strip(), said
        assert "##" not in said, said


def test_labels_have_the_same_ids_in_every_language(spoken):
    for found in list_ui_texts():
        assert make_label(found.text).rpartition("###")[2] == found.text


def test_commands_have_different_names(spoken, tmp_path, monkeypatch):
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path))
    session = EditorSession()
    register_actions(session, list_panel_actions)
    titles = Counter((translate(action.menu), translate(action.title)) for action in session.actions if action.menu)
    session.close()
    assert not [title for title, count in titles.items() if count > 1]


def test_what_panels_draw_is_looked_up():
    """No literal with words goes straight to ImGui."""
    faults = []
    for path in sorted((ROOT / "app/panels").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute) or not node.args:
                continue
            place = 1 if node.func.attr in ("text_colored", "input_text_with_hint", "begin_combo") else 0
            known = node.func.attr in SHOWN_FIRST or place
            if ast.unparse(node.func.value) != "imgui" or not known or len(node.args) <= place:
                continue
            for part in ast.walk(node.args[place]):
                if isinstance(part, ast.Call):
                    break
                text = part.value if isinstance(part, ast.Constant) else ""
                if isinstance(text, str) and WORDS.search(text) and not text.startswith("##"):
                    faults.append(f"{path.name}:{node.lineno}: {text!r}")
    assert not faults


def test_panels_keep_their_places(spoken):
    for record in PANELS:
        assert make_window_name(record.title) == f"{translate(record.title)}###{record.title}"
        assert imgui.internal.im_hash_str(make_window_name(record.title)) == imgui.internal.im_hash_str(record.title)
