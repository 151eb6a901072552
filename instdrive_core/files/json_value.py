"""JSON whose texts are text: half characters (``"\\ud800"``) can be neither printed, shown, nor written to a file."""

from __future__ import annotations

import json
import re
from typing import Any

_MAYBE_HALF = re.compile(r"\\u[dD][89a-fA-F]|[\ud800-\udfff]")
"""Escaped pairs of halves, which are whole, look the same."""


def parse_json(text: bytes | str, **options: Any) -> Any:
    """Parse JSON with `json.loads`. Raises ValueError also where a text in it holds half a character.

    Bytes of file names that are no text (PEP 383) may stand in it; `require_whole_text` refuses them, too.
    """
    if isinstance(text, bytes):
        text = text.decode(json.detect_encoding(text), "surrogatepass")
    value = json.loads(text, **options)
    if _MAYBE_HALF.search(text):
        try:
            json.dumps(value, ensure_ascii=False).encode(errors="surrogateescape")
        except UnicodeEncodeError as error:
            half = error.object[error.start : error.end]
            raise ValueError(f"a text in it holds {half!a}, which is no character") from error
    return value


def require_whole_text(value: object) -> str:
    """Return ``str(value)``, to be shown to the user. Raises ValueError where it holds half a character."""
    text = str(value)
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{text[:80]!a} holds half a character") from error
    return text
