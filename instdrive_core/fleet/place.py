"""Where runs are kept: a folder of this machine, or an address that fsspec knows (S3, GCS, memory and others)."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.fleet.plan import is_address, normalize_path


@dataclass(frozen=True)
class FleetPlace:
    """A folder of small files. Names are relative, with slashes."""

    root: str
    """Absolute path or address."""

    @property
    def folder(self) -> Path | None:
        """The folder on this machine; None where the place is an address."""
        return None if is_address(self.root) else Path(self.root)

    def read(self, name: str) -> bytes | None:
        """Read a file; None where there is none. Raises DataError where the place cannot be reached."""
        try:
            if self.folder is not None:
                return (self.folder / name).read_bytes()
            system, root = open_file_system(self.root)
            return system.cat_file(f"{root}/{name}")
        except (FileNotFoundError, NotADirectoryError):
            return None
        except Exception as error:
            problem = f"cannot be read ({type(error).__name__}: {error})"
            raise DataError(f"{self.root}/{name}", problem, "Check address, network and permission") from error

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all. Raises DataError where that fails."""
        if self.folder is not None:
            write_bytes(self.folder / name, content)
            return
        system, root = open_file_system(self.root)
        try:
            system.makedirs(posixpath.dirname(f"{root}/{name}"), exist_ok=True)
            system.pipe_file(f"{root}/{name}", content)
        except Exception as error:
            problem = f"cannot be written ({type(error).__name__}: {error})"
            raise DataError(f"{self.root}/{name}", problem, "Check address, network and permission") from error


def open_place(path: str) -> FleetPlace:
    """Open a folder or address; a folder is made where there is none."""
    place = FleetPlace(normalize_path(path))
    if place.folder is not None:
        try:
            place.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            problem = f"cannot be made ({error.strerror or error})"
            raise DataError(place.folder, problem, "Choose another --out") from error
    else:
        open_file_system(place.root)
    return place


def open_file_system(address: str) -> tuple[Any, str]:
    """Find the file system of an address, and the address's path in it. Raises OptionError for an unknown kind."""
    import fsspec

    try:
        system, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise OptionError(f"{address} cannot be opened: {error}") from error
    return system, str(path).rstrip("/")
