"""The queue of requests from the session to the window, and who answers them."""

import logging
from pathlib import Path
from types import SimpleNamespace

import pytest
from imgui_bundle import imgui

from instdrive_app.panels.dialogs import DialogHost, DialogRecord
from instdrive_app.panels.dialogs.registry import DIALOGS
from instdrive_app.session import requests
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import (
    AskClass,
    AskName,
    ReceiveDrop,
    Request,
    RequestQueue,
    ShowAbout,
    ShowPalette,
    ShowPanel,
)
from instdrive_app.shell.window import EditorWindow


def list_requests():
    """Every class of request."""
    return {kind for kind in vars(requests).values() if isinstance(kind, type) and issubclass(kind, Request)} - {
        Request
    }


def test_requests_are_answered_in_order_one_a_frame():
    queue = RequestQueue()
    queue.put(ShowAbout())
    queue.put(ShowPalette())
    assert queue.waiting == (ShowAbout(), ShowPalette())
    assert queue.take_due(is_blocked=False) == ShowAbout()
    assert queue.take_due(is_blocked=False) == ShowPalette()
    assert queue.take_due(is_blocked=False) is None


def test_an_open_dialog_holds_back_all_but_urgent_requests():
    queue, drop = RequestQueue(), ReceiveDrop((Path("a.ply"),))
    queue.put(ShowAbout())
    queue.put(drop)
    assert queue.take_due(is_blocked=True) == drop
    assert queue.take_due(is_blocked=True) is None
    assert queue.take_due(is_blocked=False) == ShowAbout()


def test_a_panel_takes_a_request_before_a_dialog_opens_for_it():
    queue = RequestQueue()
    queue.put(AskName(3))
    assert queue.take(AskClass) is None
    assert queue.take(AskName) == AskName(3)
    assert queue.take(AskName) is None
    queue.put(AskName(4))
    assert [queue.take_due(is_blocked=False) for _ in range(3)] == [None, None, AskName(4)]


def test_every_request_is_answered_by_the_window_or_one_dialog():
    session = EditorSession()
    window = EditorWindow(session)
    assert window.answers == list_requests()
    answered = [kind for record in DIALOGS for kind in record.answers]
    assert len(set(answered)) == len(answered)
    assert ShowPanel not in answered
    session.close()


def test_a_request_that_nothing_answers_is_logged(caplog, monkeypatch):
    class Unheard(Request):
        pass

    monkeypatch.setattr(imgui.internal, "get_top_most_popup_modal", lambda: None)
    ui = SimpleNamespace(session=SimpleNamespace(requests=RequestQueue()))
    ui.session.requests.put(Unheard())
    with caplog.at_level(logging.ERROR):
        DialogHost(()).draw(ui)
    assert "nothing answers the request" in caplog.text
    assert "Unheard" in caplog.text
    assert ui.session.requests.waiting == ()


def test_two_dialogs_cannot_answer_the_same_request():
    record = DialogRecord("About", "ICON_FA_CIRCLE_INFO", SimpleNamespace, (ShowAbout,))
    with pytest.raises(ValueError, match="two dialogs answer ShowAbout"):
        DialogHost((record, record))


def test_an_unknown_panel_is_logged(caplog, monkeypatch):
    session = EditorSession()
    window = EditorWindow(session)
    docking = SimpleNamespace(dockable_window_of_name=lambda name: None)
    monkeypatch.setattr(
        "instdrive_app.shell.window.hello_imgui.get_runner_params", lambda: SimpleNamespace(docking_params=docking)
    )
    with caplog.at_level(logging.ERROR):
        window._show_panel("Nowhere", closes=False)
    assert "there is no panel 'Nowhere'" in caplog.text
    session.close()
