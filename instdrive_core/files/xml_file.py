"""XML files of others, without entities, which can grow without end."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from instdrive_core.errors import DataError
from instdrive_core.files.text_file import LONGEST_TEXT, read_text

_REMEDY = "Get the file again"


def parse_xml(file: Path, longest: int = LONGEST_TEXT) -> ElementTree.Element:
    """Parse an XML file of at most `longest` bytes. Raises DataError where it is damaged, too long, or has entities."""
    text = read_text(file, longest)
    if "<!ENTITY" in text:
        raise DataError(file, "defines entities, which can grow without end", "Get the file from a source you trust")
    try:
        return ElementTree.fromstring(text.encode())
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: an encoding that nobody knows
        raise DataError(file, f"is no readable XML ({error})", _REMEDY) from error


def read_child_text(file: Path, node: ElementTree.Element, name: str, where: str) -> str:
    """Read the text of a node's child. Raises DataError where there is none."""
    text = node.findtext(name)
    if text is None:
        raise DataError(file, f"the element '{where}/{name}' is missing", _REMEDY)
    return text.strip()
