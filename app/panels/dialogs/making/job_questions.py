"""Questions about a job: what becomes of it when the editor closes, and whether an old one goes on."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.making.job_controller import PANEL
from instdrive_app.session.requests import AskLeaveJob, OfferJob, ShowPanel
from instdrive_core.wording import phrase

LEAVE_TITLE, OFFER_TITLE = "Training is running", "Unfinished training"


class LeaveJobDialog:
    """Lets the job go on without the editor, stops it, or keeps the editor open."""

    def __init__(self) -> None:
        self._request: AskLeaveJob | None = None

    def open(self, ui: Ui, request: AskLeaveJob) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(make_label(LEAVE_TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        request, making = self._request, ui.session.making
        if request is None or making.run is None:
            return
        text = phrase(
            "{name} is still being made. It can go on without the editor, which shows it again "
            "when it is started next. Or stop it; it can go on later from where it is.",
            name=making.run.name,
        )

        def stop() -> None:
            making.ask("stop")
            request.then()

        def go_on() -> None:
            making.ask("run")
            request.then()

        answers = {"Cancel": lambda: None, "Stop it": stop, "Go on in the background": go_on}
        draw_question(ui, LEAVE_TITLE, text, answers)


class OfferJobDialog:
    """Offers to go on with a job that no process runs."""

    def __init__(self) -> None:
        self._request: OfferJob | None = None

    def open(self, ui: Ui, request: OfferJob) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(make_label(OFFER_TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        request, making = self._request, ui.session.making
        if request is None:
            return

        def go_on() -> None:
            making.follow(request.run)
            making.go_on()

        def show() -> None:
            making.follow(request.run)
            ui.session.requests.put(ShowPanel(PANEL))

        text = phrase(
            "{name} is not finished. Nothing that was done is lost: it goes on from where it was.",
            name=request.run.name,
        )
        draw_question(ui, OFFER_TITLE, text, {"Later": making.forget, "Show": show, "Go on": go_on})
