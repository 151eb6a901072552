"""Every scene format, registered once: opening and saving by the path's ending or the folder's content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.allocation import MEMORY_TO_READ, WHOLE, ReadOptions, enlarge_splats
from instdrive_core.formats.folder.scenes import MANIFEST, read_scene_folder, write_scene_folder
from instdrive_core.formats.ply.compare import find_changed_value
from instdrive_core.formats.ply.compressed import read_compressed_ply, write_compressed_ply
from instdrive_core.formats.ply.inria import read_ply, write_ply
from instdrive_core.formats.ply.sibr import write_sibr_ply
from instdrive_core.formats.sog.levels import is_sog_folder, read_sog_folder
from instdrive_core.formats.sog.scenes import META, read_sog
from instdrive_core.formats.splat import read_splat, write_splat
from instdrive_core.formats.spz.scenes import read_spz, write_spz
from instdrive_core.scene.scene import Scene

SIBR = ".sibr.ply"


class SceneReader(Protocol):
    """Opens a file, or every k-th splat of it."""

    def __call__(self, path: Path, /, *, options: ReadOptions = WHOLE) -> Scene: ...


@dataclass(frozen=True)
class Format:
    """A kind of scene file."""

    title: str
    suffix: str
    """Lower case, with its dot, or the whole name; empty for folders."""
    read: SceneReader
    write: Callable[[Path, Scene], None] | None
    """None where the format is only read."""
    difference: Callable[[Path, Scene], str] | None = None
    """What a written file has that the scene has not, empty where nothing, found without reading the file whole."""


FORMATS = (
    Format("3D Gaussians, INRIA layout", ".ply", read_ply, write_ply, find_changed_value),
    Format("INRIA layout for SIBR viewers: 62 floats, nothing else", SIBR, read_ply, write_sibr_ply),
    Format("Packed .ply of SuperSplat and PlayCanvas", ".compressed.ply", read_compressed_ply, write_compressed_ply),
    Format("32 bytes per splat, no SH", ".splat", read_splat, write_splat),
    Format("Niantic, versions 1 to 4", ".spz", read_spz, write_spz),
    Format("PlayCanvas SOG archive", ".sog", read_sog, None),
    Format("PlayCanvas SOG folder", META, read_sog_folder, None),
    Format("InstDrive run or scene folder", "", read_scene_folder, write_scene_folder),
)


def open_scene(path: str | Path, keep_every: int = 1, room: float = MEMORY_TO_READ) -> Scene:
    """Open a scene file, or a run folder that holds a scene.

    Args:
        path: file or folder.
        keep_every: k opens every k-th splat only, made larger so that together they cover what all did; memory is
            taken for these.
        room: the memory that there must be, as a multiple of the scene's arrays.

    Raises DataError where it is no scene, or damaged; SceneTooLargeError where it does not fit into memory.
    """
    if keep_every < 1:
        raise OptionError(f"every {keep_every}th splat cannot be opened; give a whole number from 1")
    options = ReadOptions(keep_every, room)
    scene = _read(Path(path), options)
    if keep_every > 1:
        enlarge_splats(scene.gaussians.log_scales, keep_every)
    return scene


def _read(path: Path, options: ReadOptions) -> Scene:
    if not path.exists():
        raise DataError(path, "there is no such file or folder", "Check the path")
    if path.name == MANIFEST:
        path = path.parent
    try:
        if path.is_dir():
            return _open_folder(path, options)
        return _format_of(path).read(require_plain_file(path), options=options)
    except OSError as error:
        raise DataError(
            path, f"the file cannot be read ({error.strerror or error})", "Check its permissions"
        ) from error


def save_scene(path: str | Path, scene: Scene, *, sibr: bool = False) -> None:
    """Write a scene in the format of the path's ending; a path without one becomes a scene folder. Atomic.

    Args:
        path: file or folder to write.
        scene: what to write.
        sibr: whether a .ply of any name is written as ``.sibr.ply`` ones are; SIBR viewers want ``point_cloud.ply``.

    Raises DataError for an ending that is not known or a scene that the format cannot hold.
    """
    path = Path(path)
    _, write = find_format_to_write(path, sibr)
    write(path, scene)


def find_format_to_write(path: Path, sibr: bool = False) -> tuple[Format, Callable[[Path, Scene], None]]:
    """The format that `save_scene` takes for a path, and its writer. Raises DataError where there is none."""
    is_folder = path.is_dir() or not (path.suffix or _formats_fitting(path))
    fmt = _folder_format() if is_folder else _format_of(path)
    if sibr:
        if fmt.suffix not in (".ply", SIBR):
            raise DataError(path, "SIBR viewers read plain .ply files only", "Give a name that ends in .ply")
        fmt = next(known for known in FORMATS if known.suffix == SIBR)
    if fmt.write is None:
        known = ", ".join(fmt.suffix for fmt in FORMATS if fmt.suffix and fmt.write is not None)
        raise DataError(path, f"{fmt.suffix} can be opened but not written", f"Save as one of {known}, or to a folder")
    return fmt, fmt.write


def _open_folder(folder: Path, options: ReadOptions) -> Scene:
    if (folder / MANIFEST).is_file():
        return _folder_format().read(folder, options=options)
    if is_sog_folder(folder):
        return read_sog_folder(folder, options=options)
    problem = f"the folder holds no {MANIFEST}"
    raise DataError(folder, problem, "Open a run folder that training has written a scene to, or a scene file")


def _formats_fitting(path: Path) -> list[Format]:
    """By the whole name: pathlib finds no suffix in ``.ply``."""
    return [fmt for fmt in FORMATS if fmt.suffix and path.name.lower().endswith(fmt.suffix)]


def _format_of(path: Path) -> Format:
    if fitting := _formats_fitting(path):
        # The longest: a .compressed.ply ends in .ply too.
        return max(fitting, key=lambda fmt: len(fmt.suffix))
    known = ", ".join(fmt.suffix for fmt in FORMATS if fmt.suffix)
    raise DataError(
        path, f"files that end in {path.suffix or 'nothing'!r} are not known", f"Known are {known} and folders"
    )


def _folder_format() -> Format:
    return next(fmt for fmt in FORMATS if not fmt.suffix)
