"""SOG scenes that lie in a folder: one meta.json, or many in levels of detail, of which the finest is opened.

A streamed scene has a lod-meta.json with a tree: each leaf says, per level (0 is the finest), which rows of which
meta.json cover it. Without one, folders called ``LEVEL_CHUNK`` (``0_0``, ``0_1``, ``1_0`` …) say the same by their
names. An environment (splats far away, shown at every level) comes last.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.reader_pool import READERS, open_reader_pool
from instdrive_core.formats.allocation import (
    BESIDE_BYTES,
    MEMORY_TO_READ,
    WHOLE,
    ReadOptions,
    check_memory,
    count_row_bytes,
)
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.sog.meta import SogMeta, parse_sog_meta
from instdrive_core.formats.sog.scenes import META, PASSING, count_rest, read_sog_gaussians, read_sog_meta_scene
from instdrive_core.formats.sog.store import REMEDY, FolderStore, check_member_name
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.row_buffers import allocate_with_spare
from instdrive_core.scene.scene import Scene, scene_from_gaussians

LOD_META = "lod-meta.json"
_CHUNK = re.compile(r"(\d{1,6})_(\d{1,6})")
_MAX_NODES = 1 << 20


@dataclass(frozen=True, order=True)
class _Part:
    file: int
    start: int
    count: int


def is_sog_folder(folder: Path) -> bool:
    """Whether `read_sog_folder` can open a folder."""
    return (folder / META).is_file() or (folder / LOD_META).is_file() or bool(_find_chunk_folders(folder))


def read_sog_folder(path: str | Path, level: int = 0, options: ReadOptions = WHOLE) -> Scene:
    """Open a folder, its meta.json or its lod-meta.json.

    Args:
        path: the folder or file.
        level: 0 for the finest level of detail; where a place has none as fine as asked for, its finest.
        options: which rows are kept; of a scene of many files, those of each.

    Raises DataError where anything about the scene is wrong, also where names lead out of the folder.
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    if path.name == LOD_META or (path.is_dir() and (folder / LOD_META).is_file()):
        return _read_streamed(folder, level, options)
    if path.is_file() or (folder / META).is_file():
        return read_sog_meta_scene(FolderStore(folder), META if path.is_dir() else path.name, options)
    chunks = _find_chunk_folders(folder)
    if not chunks:
        problem = f"the folder holds no {META}, {LOD_META} or folders called LEVEL_CHUNK"
        raise DataError(folder, problem, REMEDY)
    chosen = _choose_level(level, {number for number, _ in chunks})
    sources = [(chunks[key], META) for key in sorted(chunks) if key[0] == chosen]
    if len(sources) == 1:
        return read_sog_meta_scene(FolderStore(sources[0][0]), META, options)
    return _read_chunks(sources, folder, options)


def read_sog_levels(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open the finest level of a lod-meta.json, whatever its name, or of a folder with one. Raises DataError."""
    path = Path(path)
    if path.is_dir():
        return _read_streamed(path, 0, options)
    return _read_streamed(path.parent, 0, options, path.name)


def sketch_sog_levels(path: Path, most: int) -> Scene | None:
    """Read the finest level of a streamed scene that has at most twice `most` splats, else the coarsest.

    None where that is more than a quarter of the scene, or the scene is that small. Raises DataError.
    """
    folder, name = (path, LOD_META) if path.is_dir() else (path.parent, path.name)
    tree = FolderStore(folder).read_json(name).get("tree")
    numbers = sorted({number for levels in _walk_levels(tree, folder) for number in levels})
    counts = {number: sum(part.count for part in _collect_parts(tree, number, folder)) for number in numbers}
    whole = counts.get(min(numbers, default=0), 0)
    level = next((number for number in numbers if counts[number] <= 2 * most), max(numbers, default=0))
    if whole < 2 * most or 4 * counts[level] > whole:
        return None
    return _read_streamed(folder, level, WHOLE, name)


def _find_chunk_folders(folder: Path) -> dict[tuple[int, int], Path]:
    entries = ((_CHUNK.fullmatch(entry.name), entry) for entry in folder.iterdir())
    found = {(int(match[1]), int(match[2])): entry for match, entry in entries if match}
    return {key: entry for key, entry in found.items() if (entry / META).is_file()}


def _choose_level(level: int, levels: set[int]) -> int:
    """Choose the finest level that is no finer than asked for, else the coarsest."""
    return min((number for number in levels if number >= level), default=max(levels))


def _read_streamed(folder: Path, level: int, options: ReadOptions, name: str = LOD_META) -> Scene:
    content = FolderStore(folder).read_json(name)
    version = content.get("version", 1)  # older files have none
    if version != 1:
        raise DataError(folder, f"{LOD_META} has 'version' {version!r}, not 1", "Export it as version 1")
    names = content.get("filenames")
    if not isinstance(names, list):
        raise DataError(folder, f"{LOD_META} has as 'filenames' {names!r}, not a list", REMEDY)
    parts: dict[int, list[_Part]] = {}
    for part in sorted(_collect_parts(content.get("tree"), level, folder)):
        parts.setdefault(part.file, []).append(part)
    if not parts:
        raise DataError(folder, f"the tree of {LOD_META} names no splats", REMEDY)
    if max(parts) >= len(names):
        raise DataError(folder, f"{LOD_META} uses file {max(parts)} of {len(names)} 'filenames'", REMEDY)
    used = [names[number] for number in parts]
    if content.get("environment") is not None:
        used.append(content["environment"])
    return _read_chunks([_find_source(folder, name) for name in used], folder, options, list(parts.values()))


def _keep_every(chunk: Gaussians, options: ReadOptions) -> Gaussians:
    return chunk.select(slice(None, None, options.keep_every)) if options.keep_every > 1 else chunk


def _find_source(folder: Path, name: Any) -> tuple[Path, str]:
    parts = PurePosixPath(check_member_name(name, folder))
    if not (folder / parts).is_file():
        raise DataError(folder, f"the file {name!r} is missing", REMEDY)
    return folder / parts.parent, parts.name


def _read_metas(sources: list[tuple[Path, str]], folder: Path) -> list[SogMeta]:
    if len(set(sources)) < len(sources):
        raise DataError(folder, "two chunks of the scene are the same file", REMEDY)
    return [parse_sog_meta(FolderStore(place).read_json(name), place) for place, name in sources]


def _read_chunks(
    sources: list[tuple[Path, str]], folder: Path, options: ReadOptions, shown: Sequence[list[_Part]] = ()
) -> Scene:
    """Read chunks, some at a time and each whole, into one scene, if together they can be believed and fit into memory.

    `shown` is what is kept of the first chunks; of the others, all. SH degrees are raised to the highest, as some
    chunks have none.
    """
    metas = _read_metas(sources, folder)
    stores = [FolderStore(place) for place, _ in sources]
    rest = max((count_rest(store, meta) for store, meta in zip(stores, metas, strict=True)), default=0)
    largest = max((meta.count for meta in metas), default=0)
    passing = READERS * largest * (MEMORY_TO_READ * count_row_bytes(rest, 0) + BESIDE_BYTES + PASSING)
    counts = [sum(part.count for part in rows) for rows in shown] + [meta.count for meta in metas[len(shown) :]]
    check_memory(folder, sum(counts), count_row_bytes(rest, 0), options, passing)
    ends = np.cumsum([options.count_kept(count) for count in counts]).tolist()
    shapes = [(3,), (4,), (3,), (), (3,), (rest, 3), (0,)]
    joined = Gaussians(*(allocate_with_spare((ends[-1], *shape), np.float32) for shape in shapes))

    def read_chunk(number: int) -> tuple[int, int]:
        chunk = read_sog_gaussians(stores[number], metas[number])
        count = len(chunk)
        if number < len(shown):
            chunk = _select_parts(chunk, shown[number], folder)
        chunk = _keep_every(chunk, options)
        _write_rows(chunk, joined, slice(ends[number] - len(chunk), ends[number]))
        return count, stores[number].size

    count = size = 0
    with open_reader_pool() as pool:
        for number, (more, larger) in enumerate(pool.map(read_chunk, range(len(sources)))):
            count, size = count + more, size + larger
            check_plausible_count(folder, count, size)
            report((number + 1) / len(sources))
    return replace(scene_from_gaussians(joined), antialiased=all(meta.antialiased for meta in metas))


def _write_rows(chunk: Gaussians, joined: Gaussians, rows: slice) -> None:
    rest = chunk.sh_rest.shape[1]
    for name, array in chunk.arrays().items():
        target = getattr(joined, name)[rows]
        if name == "sh_rest":
            target[:, rest:] = 0
            target = target[:, :rest]
        target[...] = array


def _collect_parts(tree: Any, level: int, folder: Path) -> list[_Part]:
    """Collect what the leaves show at a level."""
    parts = [_parse_part(levels[_choose_level(level, set(levels))], folder) for levels in _walk_levels(tree, folder)]
    return [part for part in parts if part.count]


def _walk_levels(tree: Any, folder: Path) -> Iterator[dict[int, Any]]:
    """Walk through the leaves: what each shows, by level. Not recursive: a hostile tree is as deep as it likes."""
    pending, visited = [tree], 0
    while pending:
        node = pending.pop()
        visited += 1
        if not isinstance(node, dict) or visited > _MAX_NODES:
            raise DataError(folder, f"'tree' of {LOD_META} holds {str(node)[:80]!r}, not a node", REMEDY)
        children, levels = node.get("children") or [], node.get("lods") or {}
        if not isinstance(children, list) or not isinstance(levels, dict):
            raise DataError(folder, f"a node of {LOD_META} has 'children' or 'lods' of the wrong kind", REMEDY)
        pending += children
        named = {int(key): entry for key, entry in levels.items() if key.isascii() and key.isdigit() and len(key) < 7}
        if named:
            yield named


def _parse_part(entry: Any, folder: Path) -> _Part:
    values: list[Any] = [entry.get(key) for key in ("file", "offset", "count")] if isinstance(entry, dict) else []
    if len(values) != 3 or not all(isinstance(value, int) and 0 <= value < 1 << 31 for value in values):
        problem = f"a leaf of {LOD_META} is {str(entry)[:80]!r}, not whole numbers 'file', 'offset', 'count'"
        raise DataError(folder, problem, REMEDY)
    return _Part(*values)


def _select_parts(chunk: Gaussians, parts: list[_Part], folder: Path) -> Gaussians:
    """Select the rows of all parts; each row can be shown once only."""
    end = 0
    for part in parts:
        if part.start < end or part.start + part.count > len(chunk):
            problem = f"rows {part.start} to {part.start + part.count} of file {part.file} overlap others or its end"
            raise DataError(folder, f"{LOD_META}: {problem} ({len(chunk)})", REMEDY)
        end = part.start + part.count
    if sum(part.count for part in parts) == len(chunk):
        return chunk
    return chunk.select(np.concatenate([np.arange(part.start, part.start + part.count) for part in parts]))
