"""Actions as records: menus, shortcuts, toolbar and shortcut sheet all derive from them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

MenuItem = tuple[str, Callable[[], None]]
"""Title and callback of an entry of a submenu."""


@dataclass(frozen=True)
class Action:
    """One thing the user can ask for."""

    id: str
    """Unique and stable, e.g. ``edit.delete``."""
    title: str
    run: Callable[[], object]
    menu: str = ""
    """The menu it is listed in; empty = none."""
    shortcuts: tuple[str, ...] = ()
    """E.g. ``Ctrl+Shift+Z``; the first one is shown."""
    enabled: Callable[[], bool] = lambda: True
    checked: Callable[[], bool] | None = None
    """For switches: whether it is on."""
    icon: str = ""
    """Name of an icon constant of Font Awesome 6, e.g. ``ICON_FA_TRASH``."""
    separator: bool = False
    """Whether the menu draws a line above it."""
    items: Callable[[], Sequence[MenuItem]] | None = None
    """For submenus: what they hold, asked for each time they are open; `run` is then not called from the menu."""
    undoable: bool | None = None
    """True: a step of the history. False: cannot be undone. None: changes nothing but what is shown or asked."""


def format_shortcut(shortcut: str) -> str:
    """As it is shown to the user."""
    return shortcut.replace("LeftArrow", "←").replace("RightArrow", "→").replace("Delete", "Del")


class ActionRegistry:
    """All commands, in menu order."""

    def __init__(self) -> None:
        self._commands: dict[str, Action] = {}

    def add(self, command: Action) -> None:
        """Register a command. Raises ValueError where ID or shortcut are taken."""
        if command.id in self._commands:
            raise ValueError(f"command {command.id!r} is registered twice")
        for shortcut in command.shortcuts:
            owner = next((other.id for other in self if shortcut in other.shortcuts), None)
            if owner:
                raise ValueError(f"{shortcut} is the shortcut of {owner!r} and of {command.id!r}")
        self._commands[command.id] = command

    def __iter__(self) -> Iterator[Action]:
        return iter(self._commands.values())

    def __getitem__(self, command_id: str) -> Action:
        return self._commands[command_id]

    @property
    def menus(self) -> tuple[str, ...]:
        """Menu names in the order of their first command."""
        return tuple(dict.fromkeys(command.menu for command in self if command.menu))

    def in_menu(self, menu: str) -> tuple[Action, ...]:
        """The commands of one menu."""
        return tuple(command for command in self if command.menu == menu)

    def run(self, command_id: str) -> bool:
        """Run a command if it is enabled; returns whether it ran."""
        command = self._commands[command_id]
        if not command.enabled():
            return False
        command.run()
        return True
