"""Actions as records, from which menus, shortcuts, toolbar, palette and shortcut sheet derive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from instdrive_app.language.translation import translate
from instdrive_core.wording import phrase

_KEYS = {
    "LeftArrow": "←",
    "RightArrow": "→",
    "Delete": phrase("Del"),
    "Insert": phrase("Ins"),
    "Home": phrase("Home"),
    "End": phrase("End"),
    "PageUp": phrase("Page Up"),
    "PageDown": phrase("Page Down"),
    "Ctrl": phrase("Ctrl"),
    "Shift": phrase("Shift"),
    "Alt": phrase("Alt"),
    "Space": phrase("Space"),
    "Enter": phrase("Enter"),
    "Escape": phrase("Escape"),
    "Backspace": phrase("Backspace"),
    "Tab": phrase("Tab"),
}
"""Names of keys, as the user reads them."""
MenuItem = tuple[str, Callable[[], None]]
"""Title and callback of an entry of a submenu."""


@dataclass(frozen=True)
class Action:
    """One thing that the user can do."""

    id: str
    """Unique and stable, e.g. ``edit.delete``."""
    title: str
    run: Callable[[], object]
    menu: str = ""
    """The menu that lists it; empty = none."""
    shortcuts: tuple[str, ...] = ()
    """Keys, e.g. ``Ctrl+Shift+Z``; the first ones are shown."""
    enabled: Callable[[], bool] = lambda: True
    checked: Callable[[], bool] | None = None
    """For switches: whether they are on."""
    icon: str = ""
    """Name of an icon constant of Font Awesome 6, e.g. ``ICON_FA_TRASH``."""
    separator: bool = False
    """Whether the menu draws a line above it."""
    items: Callable[[], Sequence[MenuItem]] | None = None
    """For submenus: lists their items in every frame they are open; the menu then does not call `run`."""
    words: tuple[str, ...] = ()
    """Other words by which the command palette finds it, e.g. ``screenshot``."""
    needs: str = ""
    """What the user reads where it cannot run although a scene is open and something selected."""
    undoable: bool | None = None
    """True: becomes a step of the history. False: cannot be undone. None: changes only what is shown or asked."""


def format_shortcut(shortcut: str) -> str:
    """Format keys as the user reads them in the language of the window."""
    return "+".join(translate(_KEYS.get(key, key)) if len(key) > 1 else key for key in shortcut.split("+"))


class ActionRegistry:
    """All actions, in the order of the menus."""

    def __init__(self) -> None:
        self._actions: dict[str, Action] = {}
        self.usual_keys: dict[str, tuple[str, ...]] = {}
        """The shortcuts with which actions were registered, by their IDs."""

    def add(self, action: Action) -> None:
        """Register an action. Raises ValueError where its ID or a shortcut is taken."""
        if action.id in self._actions:
            raise ValueError(f"action {action.id!r} is registered twice")
        for shortcut in action.shortcuts:
            owner = next((other.id for other in self if shortcut in other.shortcuts), None)
            if owner:
                raise ValueError(f"{shortcut} is the shortcut of {owner!r} and of {action.id!r}")
        self._actions[action.id] = action
        self.usual_keys[action.id] = action.shortcuts

    def remap(self, keys: Mapping[str, tuple[str, ...]]) -> None:
        """Give actions other shortcuts, by their IDs; those that are not named keep theirs."""
        for name, shortcuts in keys.items():
            self._actions[name] = replace(self._actions[name], shortcuts=shortcuts)

    def __iter__(self) -> Iterator[Action]:
        return iter(self._actions.values())

    def __getitem__(self, action_id: str) -> Action:
        return self._actions[action_id]

    @property
    def menus(self) -> tuple[str, ...]:
        """Menu names in the order of their first actions."""
        return tuple(dict.fromkeys(action.menu for action in self if action.menu))

    def in_menu(self, menu: str) -> tuple[Action, ...]:
        """List the actions of one menu."""
        return tuple(action for action in self if action.menu == menu)

    def run(self, action_id: str) -> bool:
        """Run an action if it is enabled; returns whether it ran."""
        action = self._actions[action_id]
        if not action.enabled():
            return False
        action.run()
        return True
