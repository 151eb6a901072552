"""Pages rendered from the templates beside this module: every text is escaped, and nothing is fetched."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from instdrive_core.files.atomic import write_bytes

_FOLDER = Path(__file__).parent
_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def write_page(path: Path, template: str, title: str, **content: Any) -> None:
    """Render a template as one self-contained page and write it atomically.

    Raises DataError where the page cannot be written.
    """
    page = load_environment().get_template(template).render(title=title, **content)
    write_bytes(path, page.encode())


@cache
def load_environment() -> Environment:
    """Templates that escape all text; characters that no page may hold become U+FFFD."""
    environment = Environment(
        loader=FileSystemLoader(_FOLDER / "templates", encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_replace_unprintable,
    )
    environment.globals["style"] = _read_asset("page.css")
    environment.globals["script"] = _read_asset("page.js")
    return environment


def _read_asset(name: str) -> Markup:
    return Markup((_FOLDER / "assets" / name).read_text(encoding="utf-8"))


def _replace_unprintable(value: Any) -> Any:
    """Replace control characters and lone surrogates, which no HTML page may hold."""
    return _UNPRINTABLE.sub("\ufffd", value) if isinstance(value, str) and not isinstance(value, Markup) else value
