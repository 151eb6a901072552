"""The SOG formats as records: an archive, a folder, a folder in levels of detail."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.formats.scene_format import Fidelity, FolderLayout, Format
from instdrive_core.formats.sog.level_writing import order_for_levels, write_sog_levels
from instdrive_core.formats.sog.levels import (
    LOD_META,
    is_sog_folder,
    read_sog_folder,
    read_sog_levels,
    sketch_sog_levels,
)
from instdrive_core.formats.sog.scenes import META, read_sog
from instdrive_core.formats.sog.writing import bound_position_error, order_for_sog, write_sog, write_sog_folder

_SUFFIXES = (".json", ".webp", ".png")


def _holds_scene(path: Path) -> bool:
    return path.is_dir() and is_sog_folder(path)


def _holds_levels(path: Path) -> bool:
    return path.is_dir() and (path / LOD_META).is_file()


def _list_files(path: Path) -> tuple[Path, ...]:
    """The images and lists of a folder, of all levels of detail."""
    folder = path if path.is_dir() else path.parent
    return tuple(sorted(file for file in folder.rglob("*") if file.suffix in _SUFFIXES and file.is_file()))


def _list_level_files(path: Path) -> tuple[Path, ...]:
    """Projects know a scene that was opened by its lod-meta.json by that file alone."""
    return _list_files(path) if path.is_dir() else (path,)


_FIDELITY = Fidelity(bound_position_error, order_for_sog)
_LEVEL_FIDELITY = Fidelity(bound_position_error, order_for_levels)
SOG_ARCHIVE = Format("PlayCanvas SOG archive", ".sog", read_sog, write_sog, _FIDELITY)
SOG_LEVELS = Format(
    "PlayCanvas SOG in levels of detail",
    LOD_META,
    read_sog_levels,
    write_sog_levels,
    _LEVEL_FIDELITY,
    folder=FolderLayout(_holds_levels, _list_level_files, last_file=LOD_META),
    sketch=sketch_sog_levels,
)
SOG_FOLDER = Format(
    "PlayCanvas SOG folder",
    META,
    read_sog_folder,
    write_sog_folder,
    _FIDELITY,
    folder=FolderLayout(_holds_scene, _list_files, last_file=META),
)
