"""A small drive in every layout that is written, for `benchmarks.fuzz` to damage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.fuzz_clip_seeds import list_pandaset_files
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.clip_recordings import record_clip
from instdrive_core.datasets.registry import DATA_SETS, load_clip

WRITTEN = tuple(data_set for data_set in DATA_SETS if data_set.write is not None)
KINDS = tuple(data_set.title for data_set in WRITTEN)
ROWS_WITHOUT_COUNT = (".bin", ".txt")
"""Endings of files that are rows and nothing else: whole rows fewer are a whole file, too."""


def list_layout_seeds(seed: Callable[..., Any]) -> Iterator[Any]:
    """One of each layout; `seed` is `fuzz_seeds.Seed`."""
    with TemporaryDirectory() as name:
        source = Path(name) / "source"
        for file, content in list_pandaset_files().items():
            (source / file).parent.mkdir(parents=True, exist_ok=True)
            (source / file).write_bytes(content)
        recording = record_clip(load_clip(str(source), ClipOptions(scale=1.0)))
        for number, data_set in enumerate(WRITTEN):
            folder = Path(name) / str(number)
            assert data_set.write is not None
            opened = data_set.write(recording, folder)
            files = (file for file in sorted(folder.rglob("*")) if file.is_file())
            content = {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}
            yield seed(data_set.title, "clip", content, opened.relative_to(folder).as_posix().removeprefix("."))
