"""Every scene format, listed once: opening and saving by the path's ending or the folder's content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.allocation import MEMORY_TO_READ, ReadOptions, enlarge_splats
from instdrive_core.formats.checkpoints.records import CHECKPOINT_CKPT, CHECKPOINT_PT, CHECKPOINT_PTH, HUGSIM_FOLDER
from instdrive_core.formats.checkpoints.training_folder import TRAINING_FOLDER
from instdrive_core.formats.clouds.records import LAS, LAZ, PCD
from instdrive_core.formats.folder.scenes import MANIFEST, SCENE_FOLDER
from instdrive_core.formats.gltf.records import GLB, GLTF
from instdrive_core.formats.ksplat.scenes import KSPLAT
from instdrive_core.formats.lcc.scenes import LCC
from instdrive_core.formats.ply.records import COMPRESSED_PLY, INRIA_PLY, SIBR_PLY
from instdrive_core.formats.scene_format import Format
from instdrive_core.formats.sog.records import SOG_ARCHIVE, SOG_FOLDER, SOG_LEVELS
from instdrive_core.formats.splat import SPLAT
from instdrive_core.formats.splatsim.records import SPLATSIM, USDZ_OF_ANY_KIND
from instdrive_core.formats.spz.scenes import SPZ
from instdrive_core.formats.usd.records import USD, USDA, USDC
from instdrive_core.formats.web_page.scenes import WEB_PAGE
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.upright import Axis

SKETCH_SPLATS = 600_000
"""Splats of a sketch, which are read and drawn in a fraction of a second."""
FORMATS: tuple[Format, ...] = (
    INRIA_PLY,
    SIBR_PLY,
    COMPRESSED_PLY,
    SPLAT,
    SPZ,
    SOG_ARCHIVE,
    GLB,
    GLTF,
    USDZ_OF_ANY_KIND,
    USDA,
    USDC,
    USD,
    SPLATSIM,
    WEB_PAGE,
    SCENE_FOLDER,
    SOG_LEVELS,
    SOG_FOLDER,
    KSPLAT,
    LCC,
    LAS,
    LAZ,
    PCD,
    CHECKPOINT_PTH,
    CHECKPOINT_PT,
    CHECKPOINT_CKPT,
    TRAINING_FOLDER,
    HUGSIM_FOLDER,
)
"""Every format, in the order of dialogs. A folder has the first format that recognises it."""


def open_scene(
    path: str | Path,
    keep_every: int = 1,
    memory_factor: float = MEMORY_TO_READ,
    *,
    time: float | None = None,
    data: Path | None = None,
) -> Scene:
    """Open a scene file, or a run folder that holds a scene.

    Args:
        path: file or folder.
        keep_every: k opens every k-th splat only, made larger so that together they cover what all did; memory is
            taken for these.
        memory_factor: the memory that there must be, as a multiple of the scene's arrays.
        time: seconds into the drive at which things that bend get their shape, where a file holds such things.
        data: folder of the data set that the scene was trained on, for tracks that its file does not hold; None looks
            beside the file and where the training's settings say.

    Raises DataError where it is no scene, or damaged; SceneTooLargeError where it does not fit into memory.
    """
    if keep_every < 1:
        raise OptionError(f"every {keep_every}th splat cannot be opened; give a whole number from 1")
    options = ReadOptions(keep_every, memory_factor, time, data)
    scene = _read(Path(path), options)
    if keep_every > 1:
        enlarge_splats(scene.gaussians.log_scales, keep_every)
    return scene


def sketch_scene(path: Path, most: int = SKETCH_SPLATS) -> Scene | None:
    """Read a sparse sketch of a whole scene, of about `most` splats, before the scene itself is opened.

    None where the format has none, or where the scene is damaged or too small for one: who opens it finds out.
    """
    try:
        fmt = find_format(path) if path.exists() else None
        if fmt is None or fmt.sketch is None:
            return None
        return fmt.sketch(require_plain_file(path), most)
    except (DataError, OSError):
        return None


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


def find_format(path: Path) -> Format | None:
    """The format of a file (by its ending) or folder (by its content); None where none fits."""
    holding = (fmt for fmt in FORMATS if fmt.folder is not None and fmt.folder.holds(path))
    found = next(holding, None)
    return found if found is not None or path.is_dir() else _find_by_ending(path)


def find_format_to_write(path: Path, sibr: bool = False) -> tuple[Format, Callable[[Path, Scene], None]]:
    """The format that `save_scene` takes for a path, and its writer. Raises DataError where there is none."""
    fmt = _find_by_ending(path)
    if path.is_dir() or not (path.suffix or fmt):
        fmt = _get_format(SCENE_FOLDER.suffix)
    if fmt is None:
        raise _create_unknown_error(path)
    if sibr:
        if fmt.suffix not in (INRIA_PLY.suffix, SIBR_PLY.suffix):
            raise DataError(path, "SIBR viewers read plain .ply files only", "Give a name that ends in .ply")
        fmt = _get_format(SIBR_PLY.suffix)
    if fmt.write is None:
        known = ", ".join(fmt.suffix for fmt in FORMATS if fmt.suffix and fmt.write is not None)
        raise DataError(path, f"{fmt.suffix} can be opened but not written", f"Save as one of {known}, or to a folder")
    return fmt, fmt.write


def find_stated_up(path: Path) -> Axis | None:
    """The axis that points up by the format of this file's ending; None where it says nothing."""
    fmt = _find_by_ending(path)
    return None if fmt is None else fmt.up


def is_scene_folder(folder: Path) -> bool:
    """Whether this is a folder that can be opened as a scene. Raises OSError where it cannot be looked into."""
    return folder.is_dir() and find_format(folder) is not None


def _read(path: Path, options: ReadOptions) -> Scene:
    if not path.exists():
        raise DataError(path, "there is no such file or folder", "Check the path")
    try:
        fmt = find_format(path)
        if fmt is None:
            raise _create_unknown_error(path)
        return fmt.read(require_plain_file(path), options=options)
    except OSError as error:
        problem = f"the file cannot be read ({error.strerror or error})"
        raise DataError(path, problem, "Check its permissions") from error


def _find_by_ending(path: Path) -> Format | None:
    """Go by the whole name, as pathlib finds no suffix in ``.ply``."""
    fitting = [fmt for fmt in FORMATS if fmt.suffix and path.name.lower().endswith(fmt.suffix)]
    # The longest: a .compressed.ply ends in .ply too.
    return max(fitting, key=lambda fmt: len(fmt.suffix), default=None)


def _get_format(suffix: str) -> Format:
    return next(fmt for fmt in FORMATS if fmt.suffix == suffix)


def _create_unknown_error(path: Path) -> DataError:
    if path.is_dir():
        remedy = "Open a run folder that training has written a scene to, or a scene file"
        return DataError(path, f"the folder holds no {MANIFEST}", remedy)
    known = ", ".join(fmt.suffix for fmt in FORMATS if fmt.suffix)
    problem = f"files that end in {path.suffix or 'nothing'!r} are not known"
    return DataError(path, problem, f"Known are {known} and folders")
