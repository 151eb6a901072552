"""The two SOG formats as records; folders are only read."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.formats.scene_format import Fidelity, FolderLayout, Format
from instdrive_core.formats.sog.levels import is_sog_folder, read_sog_folder
from instdrive_core.formats.sog.scenes import META, read_sog
from instdrive_core.formats.sog.writing import bound_position_error, order_for_sog, write_sog

_SUFFIXES = (".json", ".webp", ".png")


def _holds_scene(path: Path) -> bool:
    return path.is_dir() and is_sog_folder(path)


def _list_files(path: Path) -> tuple[Path, ...]:
    """The images and lists of a folder, of all levels of detail."""
    if not path.is_dir() and path.name != META:
        return (path,)  # a lod-meta.json: projects know such a scene by that file alone
    folder = path if path.is_dir() else path.parent
    return tuple(sorted(file for file in folder.rglob("*") if file.suffix in _SUFFIXES and file.is_file()))


_FIDELITY = Fidelity(bound_position_error, order_for_sog)
SOG_ARCHIVE = Format("PlayCanvas SOG archive", ".sog", read_sog, write_sog, _FIDELITY)
SOG_FOLDER = Format("PlayCanvas SOG folder", META, read_sog_folder, folder=FolderLayout(_holds_scene, _list_files))
