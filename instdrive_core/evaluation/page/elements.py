"""HTML that cannot be broken by what a file says: text is escaped unless it was built here."""

from __future__ import annotations

import re
from html import escape

_VOID = {"br", "img", "input", "meta"}
_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


class Markup(str):
    """Text that is HTML already; every other string is escaped where it enters an element."""

    __slots__ = ()


Content = Markup | str | None


def element(tag: str, *content: Content, **attributes: str | int | float | bool | None) -> Markup:
    """One element. Strings are escaped, `Markup` is not; None and False leave content and attributes out.

    Attribute names are written as Python allows: `class_` is ``class``, `data_value` is ``data-value``.
    """
    opening = "".join(_attribute(name, value) for name, value in attributes.items())
    if tag in _VOID:
        return Markup(f"<{tag}{opening}>")
    return Markup(f"<{tag}{opening}>{joined(*content)}</{tag}>")


def joined(*content: Content) -> Markup:
    """Pieces of a page one after the other."""
    return Markup("".join(_safe(piece) for piece in content if piece is not None))


def _safe(piece: Markup | str) -> str:
    return piece if isinstance(piece, Markup) else escape(_printable(piece))


def _attribute(name: str, value: str | int | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    name = name.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{escape(_printable(str(value)))}"'


def _printable(text: str) -> str:
    """Control characters and lone surrogates, which no HTML page may hold, are replaced."""
    return _UNPRINTABLE.sub("\ufffd", text)
