"""USD stages, opened without trusting them: nothing outside of the file's folder is read.

The library is an extra, and is loaded when the first stage is opened or made.
"""

from __future__ import annotations

import os
import shutil
import struct
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.trial import survives_trial

REMEDY = "Copy the file again with all that belongs to it, or export it again"
SPLATS = "ParticleField3DGaussianSplat"
"""Type of a prim that holds splats."""
OWN_DATA = "instdrive"
"""Key of this program's entries in a prim's custom data."""
_ENDINGS = {b"PXR-USDC": ".usdc", b"#usda": ".usda", b"PK\x03\x04": ".usdz"}
_MOST_LAYERS = 1000
_SPARE, _SPARE_PER_BYTE = 1 << 30, 6
"""Bytes of memory that a whole file may need, and those for each of its bytes."""


def load_usd(module: str) -> Any:
    """Load a module of OpenUSD, such as ``Usd``. Raises MissingExtraError where the extra is not installed."""
    try:
        return import_module(f"pxr.{module}")
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error


@contextmanager
def open_stage(path: Path) -> Iterator[Any]:
    """Open the stage of a file, whatever its ending.

    Raises DataError where it is none, UntrustedDataError where it needs files outside of its folder.
    """
    sdf, usd = load_usd("Sdf"), load_usd("Usd")
    ending = _find_ending(path)
    if ending == ".usdz":
        _check_package(path)
    with TemporaryDirectory() as name:
        named = path
        if path.suffix.lower() not in (ending, ".usd") or ending == ".usdz" != path.suffix.lower():
            named = _link(path, Path(name) / f"scene{ending}")
        if ending != ".usda":
            _require_survival(path, named)
        with refuse_usd_errors(path, "is no readable USD file", REMEDY):
            layer = sdf.Layer.FindOrOpen(str(named))
            if layer is None:
                raise DataError(path, "is no readable USD file", REMEDY)
            _check_dependencies(layer, path, named)
            stage = usd.Stage.Open(layer)
        yield stage


@contextmanager
def refuse_usd_errors(path: Path, problem: str, remedy: str) -> Iterator[None]:
    """Raise DataError for errors of the library, whose own texts may be none that can be shown."""
    tf = load_usd("Tf")
    try:
        yield
    except tf.ErrorException as error:
        error.args = (_describe_error(error),)  # what it quotes of the file may be no text, which no log could print
        raise DataError(path, f"{problem} ({error.args[0]})", remedy) from error


def _describe_error(error: Exception) -> str:
    """Describe what an error says, without where in the library's source it arose."""
    try:
        text = str(error)
    except UnicodeDecodeError:  # it quotes the file
        return "its text is not UTF-8"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return (lines[0].rpartition(" : ")[2] if lines else type(error).__name__).strip("'")[:200]


def _find_ending(path: Path) -> str:
    with path.open("rb") as file:
        beginning = file.read(8)
    for mark, ending in _ENDINGS.items():
        if beginning.startswith(mark):
            return ending
    problem = f"the file begins with {beginning!r}, not as a USD file does"
    raise DataError(path, problem, "Check that it is a .usd, .usda, .usdc or .usdz file")


def _require_survival(path: Path, named: Path) -> None:
    """Read a binary file in a process of its own first: some damage ends the process that OpenUSD runs in, or asks for
    all memory there is."""
    whole = named.resolve() if named is path else named
    if not survives_trial("instdrive_core.formats.usd.trial", whole, _SPARE + _SPARE_PER_BYTE * path.stat().st_size):
        raise DataError(path, "is damaged: OpenUSD breaks off while it reads it", REMEDY)


def _check_package(path: Path) -> None:
    """Check what the library does not: checksums, and that nothing in it is compressed, as the format demands."""
    try:
        with zipfile.ZipFile(path) as package:
            packed = [info.filename for info in package.infolist() if info.compress_type != zipfile.ZIP_STORED]
            damaged = None if packed else package.testzip()
    except (zipfile.BadZipFile, EOFError, OSError, ValueError, RuntimeError, struct.error) as error:
        raise DataError(path, f"is no readable package ({error})", REMEDY) from error
    if packed or damaged:
        problem = f"{packed[0][:200]!r} in it is compressed" if packed else f"{damaged!r} in it is damaged"
        raise DataError(path, problem, REMEDY)


def _link(path: Path, named: Path) -> Path:
    """Give the library the ending that it goes by."""
    try:
        named.symlink_to(path.resolve())
    except OSError:  # Windows lets only some users make links
        shutil.copyfile(path, named)
    return named


def _check_dependencies(root: Any, path: Path, named: Path) -> None:
    """Check that all layers that the stage is made of lie in the file's folder or package, before any is used."""
    sdf = load_usd("Sdf")
    folder, pending, seen = named.parent.resolve(), [root], {root.identifier}
    while pending:
        layer = pending.pop()
        _refuse_clips(layer, path)
        for name in layer.GetCompositionAssetDependencies():
            target = layer.ComputeAbsolutePath(name)
            if target in seen:
                continue
            seen.add(target)
            within = target.startswith((f"{named}[", f"{root.identifier}["))
            if not within and not _lies_below(target, folder):
                problem = f"it needs {name[:200]!r}, which lies outside of its folder"
                raise UntrustedDataError(path, problem, "Put all files of the scene into one folder")
            found = sdf.Layer.FindOrOpen(target)
            if found is None:
                raise DataError(path, f"it needs {name[:200]!r}, which is missing", REMEDY)
            if len(seen) > _MOST_LAYERS:
                raise DataError(path, f"it is made of more than {_MOST_LAYERS} files", "Flatten the stage first")
            pending.append(found)


def _lies_below(target: str, folder: Path) -> bool:
    file = target.partition("[")[0]
    return "://" not in file and Path(os.path.realpath(file)).is_relative_to(folder)


def _refuse_clips(layer: Any, path: Path) -> None:
    """Refuse values that lie in further files, which the list of dependencies leaves out."""
    found: list[str] = []

    def look(place: Any) -> None:
        prim = layer.GetPrimAtPath(place) if place.IsPrimPath() else None
        if prim and prim.HasInfo("clips"):
            found.append(str(place))

    layer.Traverse("/", look)
    if found:
        raise DataError(path, f"the prim {found[0]!r} takes values from clips, which are not read", "Flatten the stage")
