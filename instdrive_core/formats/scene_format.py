"""The record that describes a scene format in one place: how it is read, written, recognised and checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from jaxtyping import Float, Int64
from numpy import ndarray

from instdrive_core.formats.allocation import WHOLE, ReadOptions
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.upright import Axis


@runtime_checkable
class SceneReader(Protocol):
    """Opens a file, or every k-th splat of it. Raises DataError, naming the file, where anything about it is wrong."""

    def __call__(self, path: Path, /, *, options: ReadOptions = WHOLE) -> Scene: ...


@runtime_checkable
class SceneSketcher(Protocol):
    """Reads about `most` splats from all over a scene, made larger or coarse, in a small part of the time of all.

    Returns None where that is not possible, or no gain. Raises DataError, OSError; whoever reads the whole scene says
    what is wrong with it.
    """

    def __call__(self, path: Path, /, most: int) -> Scene | None: ...


def allow_no_error(means: Float[ndarray, "n 3"]) -> float:
    """Position error of formats that keep positions bit by bit."""
    return 0.0


@dataclass(frozen=True)
class Fidelity:
    """What a format may change between writing a scene and reading it again, as docs/formats.md states it."""

    position_error: Callable[[Float[ndarray, "n 3"]], Float[ndarray, "..."] | float] = allow_no_error
    """The largest difference (metres, broadcast to the rows) of the positions as they are ordered in the file."""
    order: Callable[[Float[ndarray, "n 3"]], Int64[ndarray, " n"]] | None = None
    """The rows in the file's order, from the positions; None where it is the scene's."""
    order_scene: Callable[[Scene], Int64[ndarray, " n"]] | None = None
    """The rows in the file's order, from the scene, where positions alone do not tell."""
    is_exact: bool = False
    """Whether all that is stored of a splat comes back bit by bit."""
    keeps_instances: bool = True
    """Whether an exact format stores instance IDs and features."""
    find_change: Callable[[Path, Scene], str] | None = None
    """Finds the first value that a written file has and the scene has not, empty where there is none, without reading
    the file whole; None where files are read back by the format's reader."""

    def find_order(self, scene: Scene) -> Int64[ndarray, " n"] | None:
        """Find the rows in the file's order; None where it is the scene's."""
        if self.order_scene is not None:
            return self.order_scene(scene)
        return None if self.order is None else self.order(scene.gaussians.means)


@dataclass(frozen=True)
class FolderLayout:
    """How a format that spreads a scene over a folder is recognised, and which files belong to it."""

    holds: Callable[[Path], bool]
    """Whether a path is a folder of this format, or the file in it that stands for the folder."""
    list_files: Callable[[Path], tuple[Path, ...]]
    """All files that are read when such a path is opened. Raises DataError where the folder is damaged."""
    last_file: str = ""
    """Name of the file that is written last and names the others; empty where the format is not written."""


@dataclass(frozen=True)
class Format:
    """A kind of scene file. A new one is its module (or room), a line in `registry.FORMATS`, and a test of its own."""

    title: str
    """Name in file dialogs."""
    suffix: str
    """Ending of its files: lower case, with its dot, or a whole name; empty where it is always a folder."""
    read: SceneReader
    write: Callable[[Path, Scene], None] | None = None
    """None where the format is only read."""
    fidelity: Fidelity | None = None
    """Losses that reading back allows; None where the format is only read."""
    up: Axis | None = None
    """The axis that points up by the format's definition, in the axes that the file is opened with; None where the
    format says nothing."""
    folder: FolderLayout | None = None
    """None for formats of single files."""
    keeps_tracks: bool = False
    """Whether what moves keeps its track; other formats hold one moment."""
    sketch: SceneSketcher | None = None
    """Reads a sparse sketch of the whole scene; None where nothing is known before all is read."""
    in_world_of_photos: bool = False
    """Whether other trainers write it, in the world of the files that they read the cameras from; scenes of this
    program are in the world of its clips, which is upright and in metres."""

    def __post_init__(self) -> None:
        if (self.write is None) != (self.fidelity is None):
            raise ValueError(f"the format {self.title!r} must say what it keeps if it is written, and only then")
