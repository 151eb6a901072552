"""Pages and the parts that they have in common: figures, tables, sections."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

from instdrive_core.evaluation.page.elements import Content, Markup, element, joined
from instdrive_core.evaluation.page.style import SCRIPT, STYLE
from instdrive_core.files.atomic import write_bytes

_NUMBER = '<td class="number'


def write_page(path: Path, title: str, *content: Content) -> None:
    """Write one self-contained page, atomically. Raises DataError where it cannot be written."""
    write_bytes(path, page(title, *content).encode())


def page(title: str, *content: Content) -> Markup:
    """A whole page around its content."""
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", title),
        element("style", Markup(STYLE)),
    )
    body = element(
        "body",
        element("input", type="checkbox", id="bijective", aria_label="Colours of the bijective ID map"),
        element("main", *content),
        element("script", Markup(SCRIPT)),
    )
    return Markup(f"<!doctype html>\n{element('html', head, body, lang='en')}\n")


def color_switch() -> Markup:
    """Shows every ID map in the colours of matched objects, or in those of the bijective map."""
    return element(
        "label", "ID maps: every ID in its own colour of the bijective map", for_="bijective", class_="switch"
    )


def card(value: str, name: str) -> Markup:
    """One headline figure."""
    return element("div", element("b", value), element("span", name), class_="card")


def table(columns: Sequence[str], rows: Sequence[Sequence[Content]], **attributes: str) -> Markup:
    """A table of text cells; a cell that is a ``td`` or ``th`` element already is taken as it is."""
    aligned = [isinstance(cell, Markup) and cell.startswith(_NUMBER) for cell in rows[0]] if rows and columns else []
    heads = [element("th", name, class_="number" if number else None) for name, number in zip_longest(columns, aligned)]
    head = element("tr", *heads) if columns else None
    lines = [element("tr", *(_cell(cell) for cell in row)) for row in rows]
    shown = element("table", element("thead", head) if head else None, element("tbody", *lines), **attributes)
    return element("div", shown, class_="scroll")


def number_cell(text: str, value: float | None = None, below: str = "", class_: str = "") -> Markup:
    """A right-aligned cell that is sorted by `value`; unknown values sort below all others.

    Args:
        below: a smaller line under the number.
    """
    small = element("span", below, class_="delta") if below else None
    order = -1e9 if value is None else value
    return element("td", text, small, class_=f"number {class_}".rstrip(), data_value=order)


def section(title: str, *content: Content) -> Markup:
    """A heading and what stands below it."""
    return joined(element("h2", title), *content)


def _cell(cell: Content) -> Markup:
    if isinstance(cell, Markup) and cell.startswith(("<td", "<th")):
        return cell
    return element("td", cell)
