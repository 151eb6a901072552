"""Texts of the window, found in the sources: what the catalogues must translate.

Every literal that reads like words is one, unless it stands where nobody reads it: in docstrings, annotations, logs,
marks, names of files and of keys. Templates are literals too; f-strings with words cannot be translated and are
listed as faults.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = (
    *("app/actions", "app/panels", "app/session", "app/tools", "app/preferences"),
    *("app/action.py", "app/jobs.py", "app/state.py", "app/messages.py", "app/shell/window.py", "app/language"),
    *("instdrive_core/edits/kinds", "instdrive_core/edits/bases", "instdrive_core/edits/queries"),
    *("instdrive_core/edits/document/edit.py", "instdrive_core/edits/deletions"),
    "instdrive_core/finding/relabeling.py",
)
"""Folders and files whose texts the window shows."""
MARKED = (
    *("app/files/file_names.py", "instdrive_core/errors.py", "instdrive_core/jobs", "instdrive_core/filming/film.py"),
    *("instdrive_core/scene/lint.py", "instdrive_core/scene/up_estimate.py", "instdrive_core/formats"),
)
"""Folders and files with other texts, too: here only phrases count."""
UNREAD_CALLS = frozenset(
    [
        *("mark", "debug", "warning", "exception", "getattr", "ValueError", "KeyError", "TypeVar", "ShowPanel"),
        *("AssertionError", "NotImplementedError", "startswith", "endswith", "split", "is_key", "get_icon"),
        *("is_key_pressed", "strftime", "getenv", "RuntimeError", "TypeError", "fromisoformat"),
    ]
)
"""Functions whose arguments nobody reads in the window."""
NOT_TEXT = re.compile(
    r"ICON_\w+|##.*|(--)?[a-z]+(-[a-z]+)+-?|\S*(->|\[A-Z)\S*|[A-Z][A-Z0-9_]+|\w*[./%:_]\S*|((Ctrl|Alt|Shift)\+)+\S+|F\d+|(Page|Left|Right)[A-Z]\w+|"
    r"(Ctrl|Alt|Shift|Enter|Escape|Space|Backspace|End|Home|Tab|Right|RightBottom|Bottom|Beside|MainDockSpace|Wanted|Value|Selection)"
)
"""Whole literals that are icons, IDs, constants, names of files and formats, keys or type variables."""
WORDS = re.compile(r"[^\W\d_]{2,}[^\W\d_]*\W+[^\W\d_]|^\W*[A-Z][a-z]+", re.S)
"""What a literal must contain to read like words: two of them, or a capital at its start."""
PLACEHOLDER = re.compile(r"\{[^{}]*\}")


@dataclass(frozen=True)
class UiText:
    """One text, and where it first stands."""

    text: str
    plural: str
    """What it is for other counts than 1; empty where nothing is counted."""
    place: str
    """File and line."""


def list_ui_texts(root: Path = ROOT) -> list[UiText]:
    """List the texts of all rooms in the order of their files, each once.

    Raises ValueError for an f-string with words where a phrase is needed.
    """
    found: dict[tuple[str, str], UiText] = {}
    faults: list[str] = []
    for path, is_marked in _list_sources(root):
        reader = _Reader(path.relative_to(root).as_posix(), is_marked)
        reader.visit(ast.parse(path.read_text(encoding="utf-8")))
        faults += reader.faults
        for text in reader.found:
            found.setdefault((text.text, text.plural), text)
    if faults:
        raise ValueError("\n".join(faults))
    counted = {text.text for text in found.values() if text.plural}
    return [text for text in found.values() if text.plural or text.text not in counted]


def _list_sources(root: Path) -> Iterator[tuple[Path, bool]]:
    """The files, and whether only phrases count in them."""
    for room in (*ROOMS, *MARKED):
        for path in sorted((root / room).rglob("*.py")) if (root / room).is_dir() else [root / room]:
            yield path, room in MARKED


class _Reader(ast.NodeVisitor):
    """Collects the texts of one file."""

    def __init__(self, name: str, is_marked: bool) -> None:
        self._name, self._is_marked = name, is_marked
        self.found: list[UiText] = []
        self.faults: list[str] = []

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_arg(self, node: ast.arg) -> None:
        """Annotations hold no texts."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for part in (*node.args.defaults, *(word for word in node.args.kw_defaults if word), *node.body):
            self.visit(part)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        if not isinstance(node.slice, ast.Constant | ast.Tuple):
            self.visit(node.slice)

    def visit_Assert(self, node: ast.Assert) -> None:
        """What asserts say is for developers."""

    def visit_Compare(self, node: ast.Compare) -> None:
        """Nothing that is compared is shown there."""

    def visit_Call(self, node: ast.Call) -> None:
        name = _name_called(node)
        if name in UNREAD_CALLS or ast.unparse(node.func).startswith("_log."):
            return
        if name in ("phrase", "translate", "make_label") and (text := _read_text(node.args[0])):
            self._add(text, "", node)
            for part in (*node.args[1:], *(word.value for word in node.keywords)):
                self.visit(part)
            return
        if name == "count_phrase":
            self._add(_read_text(node.args[1]), _read_text(node.args[2]), node)
            for part in (node.args[0], *(word.value for word in node.keywords)):
                self.visit(part)
            return
        if name == "Format" and (text := _read_text(node.args[0])):
            self._add(text, "", node)
        if name == "format_count":
            self._add_count(node)
            self.visit(node.args[0])
            return
        for word in node.keywords:
            if word.arg == "words" and isinstance(word.value, ast.Tuple):
                for part in word.value.elts:
                    if word_text := _read_text(part):
                        self._add(word_text, "", part)
            elif word.arg not in ("icon", "shortcuts", "id", "menu_id"):
                self.visit(word.value)
        self.visit(node.func)
        for part in node.args:
            self.visit(part)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        written = "".join(_read_text(part) or "0" for part in node.values)
        if not self._is_marked and WORDS.search(written.split("##")[0]) and not NOT_TEXT.fullmatch(written):
            self.faults.append(f"{self._name}:{node.lineno}: write {ast.unparse(node)} as phrase(…) or translate(…)")
        for part in node.values:
            if isinstance(part, ast.FormattedValue):
                self.visit(part.value)

    def visit_Constant(self, node: ast.Constant) -> None:
        text = node.value
        if self._is_marked or not isinstance(text, str):
            return
        if WORDS.search(PLACEHOLDER.sub("", text)) and not NOT_TEXT.fullmatch(text):
            self._add(text, "", node)

    def _add_count(self, node: ast.Call) -> None:
        one, *rest = (_read_text(noun) for noun in node.args[1:])
        if one:  # else a noun that is itself chosen: its choices are counted elsewhere
            self._add(f"{{count:,}} {one}", f"{{count:,}} {rest[0] if rest else f'{one}s'}", node)

    def _add(self, text: str, plural: str, node: ast.expr) -> None:
        if re.search(r"[^\W\d_]", PLACEHOLDER.sub("", text)):  # else all words are filled in
            self.found.append(UiText(text, plural, f"{self._name}:{node.lineno}"))


def _name_called(node: ast.Call) -> str:
    function = node.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _read_text(node: ast.expr) -> str:
    """The text of a literal; empty where it is none."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
