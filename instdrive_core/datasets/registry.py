"""Every data set, registered once: a clip's folder is opened by the first that knows its layout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.colmap.clips import holds_colmap, load_colmap
from instdrive_core.datasets.nerfstudio import holds_nerfstudio, load_nerfstudio
from instdrive_core.datasets.pandaset.clips import load_pandaset


@dataclass(frozen=True)
class DataSet:
    """A layout of driving clips on disk."""

    title: str
    """As users know it."""
    holds: Callable[[str], bool]
    """Whether a folder is laid out like this; cheap."""
    load: Callable[[str, ClipOptions], Clip]
    """Raises DataError where a file is damaged, OptionError for unknown cameras."""


DATA_SETS = (
    DataSet("nerfstudio", holds_nerfstudio, load_nerfstudio),
    DataSet("COLMAP", holds_colmap, load_colmap),
    # The last one names what it misses in a folder that no data set knows.
    DataSet("PandaSet", lambda _: True, load_pandaset),
)
"""Asked in this order. A new data set is its file or room, a line here, and its test."""


def load_clip(path: str, options: ClipOptions) -> Clip:
    """Open a clip of any known data set.

    Raises DataError where the folder is no clip or a file in it is damaged, OptionError for unknown cameras.
    """
    return next(known for known in DATA_SETS if known.holds(path)).load(path, options)
