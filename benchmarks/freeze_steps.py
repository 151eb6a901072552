"""What is done to everything at once in the editor's window: the steps whose longest frames `benchmarks.freezes` tells.

A step begins with the scene as it was opened; what it needs (a selection, an edit before it) is done first, unmeasured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.monkey_hands import Hands
from instdrive_app.session.color_controller import ColorMode
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import (
    AskClass,
    AskExport,
    AskReassign,
    AskSplit,
    OfferCleanup,
    Request,
    ShowPalette,
)
from instdrive_app.shell.window import EditorWindow
from instdrive_core.edits.bases.adjustments import RANGES, AdjustKind
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.project.save import SUFFIX

RED = (0.82, 0.13, 0.13)
HISTORY = 2000
"""Edits of a long history; some of them of everything."""
EVERYTHING = 400


@dataclass(frozen=True)
class Desk:
    """The window, its session, the user's hands, and a folder to write into."""

    window: EditorWindow
    hands: Hands
    folder: Path

    @property
    def session(self) -> EditorSession:
        """The window's."""
        return self.window.session

    @property
    def document(self) -> Document:
        """The open one."""
        assert self.session.document is not None
        return self.session.document

    @property
    def ids(self) -> tuple[int, ...]:
        """All instances that are left."""
        return self.document.find_visible_instances()

    def largest(self, count: int) -> tuple[int, ...]:
        """The instances with the most splats."""
        counts = self.document.count_states()
        return tuple(counts.ids[np.argsort(-counts.count)[:count]].tolist())

    def run(self, command: str) -> None:
        """Run a command of the menus."""
        self.session.actions.run(command)

    def middle(self, mark: str) -> tuple[float, float]:
        """Where a widget is."""
        left, top, right, bottom = self.window.ui.marks[mark]
        return (left + right) / 2, (top + bottom) / 2

    def click(self, mark: str) -> Iterator[None]:
        """Click a widget."""
        self.hands.move(*self.middle(mark))
        yield from frames(3)
        self.hands.press(1)
        yield from frames(2)
        self.hands.release(1)
        yield from frames(3)


Act = Callable[[Desk], Iterator[None] | None]


@dataclass(frozen=True)
class Step:
    """One thing that a user does."""

    name: str
    act: Act
    before: tuple[Act, ...] = field(default=())
    edits: bool = True
    """Whether it can be undone: then undo and redo are measured, too."""


def frames(count: int) -> Iterator[None]:
    """So many frames."""
    for _ in range(count):
        yield


def command(name: str) -> Act:
    """Runs a command of the menus."""
    return lambda desk: desk.run(name)


def _select_largest(count: int) -> Act:
    return lambda desk: desk.session.selection.select(desk.largest(count))


def _recolor(desk: Desk, mode: ColorMode = "tint") -> None:
    desk.session.colors.recolor(desk.session.selection.ids, mode, RED)


def _adjust(what: AdjustKind, amount: float) -> Act:
    return lambda desk: desk.session.colors.adjust(desk.session.selection.ids, what, amount)


def _slide(what: AdjustKind) -> Act:
    """A slider dragged: every frame replaces the edit of the one before."""

    def act(desk: Desk) -> Iterator[None]:
        low, high, _ = RANGES[what]
        for share in np.linspace(0.2, 0.45, 6):
            desk.session.colors.adjust(desk.session.selection.ids, what, low + share * (high - low), "slide")
            yield

    return act


def _place(shift: float = 0.0, yaw: float = 0.0, scale: float = 1.0) -> Act:
    """Type another number."""

    def act(desk: Desk) -> None:
        moving = desk.session.movement
        before = moving.find_placement()
        x, y, z = before.position
        moving.place(before, replace(before, position=(x + shift, y, z), yaw=before.yaw + yaw, scale=scale))

    return act


def _drag(tool: str, handle: str) -> Act:
    """Drag a handle of the gizmo."""

    def act(desk: Desk) -> Iterator[None]:
        desk.run(f"tool.{tool}")
        yield from frames(4)
        x, y = desk.middle(f"gizmo.{handle}")
        desk.hands.move(x, y)
        yield from frames(4)
        desk.hands.press(1)
        yield from frames(3)
        for step in range(1, 8):
            desk.hands.move(x + 6 * step, y + 3 * step)
            yield from frames(2)
        desk.hands.release(1)
        yield from frames(3)
        desk.run("tool.pick")

    return act


def _in_focus(desk: Desk) -> Iterator[None]:
    desk.run("view.frame")
    yield from frames(2)


def _solo(desk: Desk) -> None:
    desk.session.visibility.solo.enter(desk.ids[: len(desk.ids) // 2])


def _search(desk: Desk) -> Iterator[None]:
    yield from desk.click("instances.search")
    desk.hands.type("12")
    yield from frames(8)
    for _ in range(2):
        desk.hands.hold("BackSpace")
        yield from frames(2)
        desk.hands.let_go()
        yield from frames(2)
    desk.hands.hold("Escape")
    yield from frames(2)
    desk.hands.let_go()


def _sort(desk: Desk) -> Iterator[None]:
    left, top, right, _ = desk.window.ui.marks["instances.search"]
    height = desk.window.ui.marks["instances.search"][3] - top
    for share in (0.3, 0.55, 0.3, 0.1):
        desk.hands.move(left + share * (right - left), top + 1.7 * height)
        yield from frames(3)
        desk.hands.press(1)
        yield from frames(2)
        desk.hands.release(1)
        yield from frames(4)


def _dialog(make: Callable[[tuple[int, ...]], Request]) -> Act:
    def act(desk: Desk) -> Iterator[None]:
        desk.session.requests.put(make(desk.session.selection.ids))
        yield from frames(12)
        desk.hands.hold("Escape")
        yield from frames(2)
        desk.hands.let_go()
        yield from frames(6)

    return act


def _long_history(desk: Desk) -> Iterator[None]:
    document, ids = desk.document, desk.ids
    for number in range(HISTORY):
        chosen = ids if number % EVERYTHING == 0 else (ids[number % len(ids)],)
        desk.session.colors.recolor(chosen, "tint", (number / HISTORY, 0.5, 0.5))
        if number % EVERYTHING == 0:
            yield
    assert len(document.history.edits) == HISTORY, desk.session.messages.log[-1].text


def _jump(cursor: int) -> Act:
    return lambda desk: desk.session.history.jump(cursor)


def _merge_largest(count: int) -> Act:
    def act(desk: Desk) -> None:
        desk.session.selection.select(desk.largest(count))
        desk.run("labels.merge")

    return act


def _split(desk: Desk) -> None:
    desk.session.labels.split(SplitInstance(desk.session.selection.ids[0], 0.2))


ALL = (command("select.all"),)
STEPS = (
    Step("select all", command("select.all")),
    Step("select all in the list", lambda desk: desk.session.selection.select(desk.ids)),
    Step("invert", command("select.invert"), (_select_largest(100),)),
    Step("select nothing", command("select.none"), ALL),
    Step("grow", command("select.grow"), (_select_largest(2000),)),
    Step("grow all", command("select.grow"), ALL, edits=False),
    Step("shrink", command("select.shrink"), (_select_largest(2000),)),
    Step("shrink all", command("select.shrink"), ALL, edits=False),
    Step("delete all", command("edit.delete"), ALL),
    Step("delete half", command("edit.delete"), (_select_largest(1000),)),
    Step("hide all", command("edit.hide"), ALL),
    Step("show all", command("edit.show_all"), (*ALL, command("edit.hide"))),
    Step("lock all", command("edit.lock"), ALL),
    Step("unlock all", command("edit.unlock_all"), (*ALL, command("edit.lock"))),
    Step("solo half", _solo),
    Step("leave solo", lambda desk: desk.session.visibility.solo.leave(), (_solo,)),
    Step("tint all", _recolor, ALL),
    Step("hue all", lambda desk: _recolor(desk, "hue"), ALL),
    Step("paint all", lambda desk: _recolor(desk, "paint"), ALL),
    Step("solid all", lambda desk: _recolor(desk, "solid"), ALL),
    Step("reset colours of all", command("edit.reset_colors"), (*ALL, _recolor)),
    Step("brightness of all", _adjust("brightness", 1.3), ALL),
    Step("contrast of all", _adjust("contrast", 1.3), ALL),
    Step("opacity of all", _adjust("opacity", 0.5), ALL),
    Step("slide hue of all", _slide("hue"), ALL),
    Step("slide contrast of all", _slide("contrast"), ALL),
    Step("slide contrast of all tinted", _slide("contrast"), (*ALL, _recolor)),
    Step("move all", _place(shift=1.0), ALL),
    Step("turn all", _place(yaw=10.0), ALL),
    Step("scale all", _place(scale=1.1), ALL),
    Step("move all tinted", _place(shift=1.0), (*ALL, _recolor)),
    Step("put all on the ground", command("move.put_on_ground"), ALL),
    Step("reset the move of all", command("move.reset"), (*ALL, _place(shift=1.0))),
    Step("drag all", _drag("move", "x"), (*ALL, _in_focus)),
    Step("drag to turn all", _drag("rotate", "z"), (*ALL, _in_focus)),
    Step("drag to scale all", _drag("scale", "x"), (*ALL, _in_focus)),
    Step("duplicate one", command("move.duplicate"), (_select_largest(1),)),
    Step("duplicate six", command("move.duplicate"), (_select_largest(6),)),
    Step("duplicate all", command("move.duplicate"), ALL),
    Step("insert a scene", lambda desk: desk.session.insertion.insert(desk.folder / "inserted.ply")),
    Step("merge 300", command("labels.merge"), (_select_largest(300),)),
    Step("merge all", command("labels.merge"), ALL),
    Step("class of all", lambda desk: desk.session.labels.set_class(desk.ids, "Car"), ALL),
    Step("new instance from all", command("labels.new"), ALL),
    Step("take all out", lambda desk: desk.session.labels.reassign(0), ALL),
    Step("absorb floaters of one", command("labels.absorb"), (_select_largest(1),)),
    Step("absorb floaters of 20", command("labels.absorb"), (_select_largest(20),)),
    Step("split what was merged of 300", _split, (_merge_largest(300),)),
    Step("split dialog", _dialog(lambda ids: AskSplit(ids[0])), (_select_largest(1),), edits=False),
    Step("findings dialog", _dialog(lambda _: OfferCleanup()), edits=False),
    Step("export dialog", _dialog(lambda _: AskExport()), edits=False),
    Step("export dialog of all selected", _dialog(lambda _: AskExport("selection")), ALL, edits=False),
    Step("class dialog of all", _dialog(AskClass), ALL, edits=False),
    Step("reassign dialog of all", _dialog(lambda _: AskReassign()), ALL, edits=False),
    Step("command palette", _dialog(lambda _: ShowPalette()), ALL, edits=False),
    Step("search the list", _search, edits=False),
    Step("sort the list", _sort, edits=False),
    Step("jump to the beginning", _jump(0), (_long_history,), edits=False),
    Step("jump to the end", _jump(HISTORY), (_long_history, _jump(0)), edits=False),
    Step(
        "save with a long history",
        lambda desk: desk.session.files.save(desk.folder / f"saved{SUFFIX}"),
        (_long_history,),
        edits=False,
    ),
    Step("export all", lambda desk: desk.session.export.write(desk.folder / "exported.ply"), edits=False),
)
