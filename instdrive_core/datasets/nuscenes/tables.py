"""The tables of nuScenes and T4: JSON lists of records that name each other by token."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.files.json_value import require_whole_text

Row = dict[str, Any]
_REMEDY = "Get the tables again"


class Tables:
    """Tables of a folder, each read when first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._rows: dict[str, list[Row]] = {}
        self._by_token: dict[str, dict[str, Row]] = {}

    def file(self, name: str) -> Path:
        """The table's file."""
        return self.folder / f"{name}.json"

    def rows(self, name: str) -> list[Row]:
        """All rows of a table. Raises DataError where it is no list of objects."""
        if name not in self._rows:
            content = read_json(self.file(name))
            if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
                raise DataError(self.file(name), "expected a list of objects", _REMEDY)
            self._rows[name] = content
        return self._rows[name]

    def find(self, name: str, token: str, asked_by: str) -> Row:
        """Find the row with a token. Raises DataError where there is none."""
        if name not in self._by_token:
            rows = self.rows(name)
            self._by_token[name] = {self.text(name, row, "token"): row for row in rows}
        found = self._by_token[name].get(token)
        if found is None:
            problem = f"has no row with the token {token[:60]!r}, which the table '{asked_by}' names"
            raise DataError(self.file(name), problem, _REMEDY)
        return found

    def follow(self, name: str, row: Row, target: str) -> Row:
        """Find the row of the table `target` that a row of the table `name` points to."""
        return self.find(target, self.text(name, row, f"{target}_token"), name)

    def text(self, name: str, row: Row, key: str) -> str:
        """Read a text of a row. Raises DataError where it is missing or no text."""
        value = require_field(self.file(name), row, key, f"{str(row.get('token'))[:60]}.")
        if not isinstance(value, str):
            raise DataError(self.file(name), f"the field '{key}' is {str(value)[:60]!r}, expected a text", _REMEDY)
        try:
            return require_whole_text(value)
        except ValueError as error:
            raise DataError(self.file(name), f"the field '{key}' cannot be used ({error})", _REMEDY) from error

    def integer(self, name: str, row: Row, key: str) -> int:
        """Read a whole number of a row, e.g. microseconds."""
        value = require_field(self.file(name), row, key, f"{str(row.get('token'))[:60]}.")
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**62:
            problem = f"the field '{key}' is {str(value)[:60]!r}, expected a whole number"
            raise DataError(self.file(name), problem, _REMEDY)
        return value

    def having(self, name: str, key: str, wanted: Iterable[str]) -> list[Row]:
        """List the rows of a table whose text `key` is one of the wanted."""
        known = frozenset(wanted)
        return [row for row in self.rows(name) if isinstance(row.get(key), str) and row[key] in known]
