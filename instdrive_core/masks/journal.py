"""Journal of an unfinished folder of masks, so that an interrupted command can go on.

``masks.partial.jsonl``: a line with the recipe, then a line per frame, each added when the frame's files are whole. A
line that was cut off, and all after it, count as not written.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

JOURNAL = "masks.partial.jsonl"


class MaskJournal:
    """The frames written so far by the same recipe, and the file that remembers them.

    Args:
        folder: the folder of masks.
        recipe: all that masks depend on, as JSON can hold it; None = go on with nothing.
    """

    def __init__(self, folder: Path, recipe: dict[str, Any] | None) -> None:
        self.file = folder / JOURNAL
        self.entries: dict[str, dict[str, Any]] = {}
        """Entry of the sidecar by frame key, in the order of writing."""
        self._recipe = recipe
        lines = _read_lines(self.file)
        if recipe is not None and lines and lines[0] == {"recipe": recipe}:
            self.entries = {line["frame"]: line["entry"] for line in lines[1:] if _is_entry(line)}

    def keep(self, is_whole: Callable[[str, dict[str, Any]], bool]) -> None:
        """Forget frames of which something is not as it should be."""
        self.entries = {key: entry for key, entry in self.entries.items() if is_whole(key, entry)}

    def begin(self) -> None:
        """Write what is kept. Raises OSError where the folder cannot be written."""
        frames = [{"frame": key, "entry": entry} for key, entry in self.entries.items()]
        lines = [json.dumps(line) + "\n" for line in ({"recipe": self._recipe}, *frames)]
        self.file.write_text("".join(lines), encoding="utf-8")

    def add(self, key: str, entry: dict[str, Any]) -> None:
        """Add a frame whose files are whole."""
        self.entries[key] = entry
        with self.file.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"frame": key, "entry": entry}) + "\n")

    def close(self) -> None:
        """Remove the file: the folder is finished."""
        self.file.unlink(missing_ok=True)


def _read_lines(file: Path) -> list[Any]:
    """Lines up to the first that cannot be read."""
    found: list[Any] = []
    try:
        for line in file.read_text(encoding="utf-8").splitlines():
            found.append(json.loads(line))
    except (OSError, ValueError, RecursionError):
        pass  # what cannot be read is written again
    return found


def _is_entry(line: Any) -> bool:
    if not isinstance(line, dict) or not isinstance(line.get("frame"), str):
        return False
    entry = line.get("entry")
    return isinstance(entry, dict) and all(isinstance(entry.get(name), int) for name in ("width", "height", "masks"))
