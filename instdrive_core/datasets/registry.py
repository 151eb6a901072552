"""Every data set, registered once: a clip's folder is opened by the first that knows its layout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.datasets.argoverse.clips import holds_argoverse, load_argoverse
from instdrive_core.datasets.argoverse.write import write_argoverse
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.colmap.clips import holds_colmap, load_colmap
from instdrive_core.datasets.drivestudio.clips import holds_drivestudio, load_drivestudio
from instdrive_core.datasets.drivestudio.write import write_drivestudio
from instdrive_core.datasets.kitti.kitti360 import holds_kitti360, load_kitti360
from instdrive_core.datasets.kitti.raw import holds_kitti_raw, load_kitti_raw
from instdrive_core.datasets.kitti.tracking import holds_kitti_tracking, load_kitti_tracking
from instdrive_core.datasets.kitti.write import write_kitti_raw, write_kitti_tracking
from instdrive_core.datasets.kitti.write360 import write_kitti360
from instdrive_core.datasets.nerfstudio import holds_nerfstudio, load_nerfstudio
from instdrive_core.datasets.nuscenes.clips import holds_nuscenes, holds_t4, load_nuscenes, load_t4
from instdrive_core.datasets.nuscenes.write import write_nuscenes, write_t4
from instdrive_core.datasets.pandaset.clips import holds_pandaset, load_pandaset
from instdrive_core.datasets.pandaset.write import write_pandaset
from instdrive_core.datasets.recording import Recording
from instdrive_core.datasets.waymo.clips import holds_waymo, load_waymo
from instdrive_core.datasets.waymo.write import write_waymo
from instdrive_core.errors import DataError


@dataclass(frozen=True)
class DataSet:
    """A layout of driving clips on disk."""

    title: str
    """Name that users know it by."""
    needs: str
    """Words on what a folder must hold to be opened as this."""
    holds: Callable[[str], bool]
    """Whether a folder is laid out like this; cheap."""
    load: Callable[[str, ClipOptions], Clip]
    """Raises DataError where a file is damaged, OptionError for unknown cameras."""
    write: Callable[[Recording, Path], Path] | None = None
    """Writes a recording below a new folder in this layout and returns the folder to open; None where nothing does."""


DATA_SETS = (
    DataSet("nerfstudio", "a file 'transforms.json'", holds_nerfstudio, load_nerfstudio),
    DataSet("COLMAP", "a model in 'sparse/0' or 'sparse', photos in 'images'", holds_colmap, load_colmap),
    DataSet(
        "PandaSet",
        "folders 'camera' and 'meta' of one sequence, e.g. 002",
        holds_pandaset,
        load_pandaset,
        write_pandaset,
    ),
    DataSet(
        "drivestudio",
        "what drivestudio's preprocessing made of one scene: 'images', 'extrinsics', 'intrinsics' and 'ego_pose'",
        holds_drivestudio,
        load_drivestudio,
        write_drivestudio,
    ),
    DataSet(
        "KITTI raw",
        "a synchronised drive with 'image_02' and 'oxts', its calibration beside it, e.g. 2011_09_26_drive_0001_sync",
        holds_kitti_raw,
        load_kitti_raw,
        write_kitti_raw,
    ),
    DataSet(
        "KITTI tracking",
        "a sequence's photos, e.g. training/image_02/0004, with 'calib', 'oxts' and the rest beside 'image_02'",
        holds_kitti_tracking,
        load_kitti_tracking,
        write_kitti_tracking,
    ),
    DataSet(
        "KITTI-360",
        "a drive below 'data_2d_raw', e.g. 2013_05_28_drive_0003_sync, with 'calibration' and 'data_poses' beside that",
        holds_kitti360,
        load_kitti360,
        write_kitti360,
    ),
    DataSet(
        "Argoverse 2",
        "one log of the sensor data set, with 'city_SE3_egovehicle.feather', 'calibration' and 'sensors'",
        holds_argoverse,
        load_argoverse,
        write_argoverse,
    ),
    DataSet(
        "nuScenes",
        "tables in 'v1.0-…', and the name of a scene after the folder, e.g. nuscenes/scene-0061",
        holds_nuscenes,
        load_nuscenes,
        write_nuscenes,
    ),
    DataSet(
        "Waymo",
        "tables of version 2 by component, and the name of a segment after their folder, e.g. training/1001…_000",
        holds_waymo,
        load_waymo,
        write_waymo,
    ),
    DataSet("T4", "a data set of TIER IV with tables in 'annotation'", holds_t4, load_t4, write_t4),
)
"""Asked in this order. A new data set is its file or room, a line here, and its test."""


def find_data_set(path: str) -> DataSet | None:
    """Find the first data set that knows a folder's layout; None where none does."""
    return next((data_set for data_set in DATA_SETS if data_set.holds(path)), None)


def load_clip(path: str, options: ClipOptions) -> Clip:
    """Open a clip of any known data set.

    Raises DataError where there is no such folder, no data set knows its layout or a file in it is damaged, OptionError
    for unknown cameras.
    """
    data_set = find_data_set(path)
    if data_set is not None:
        return data_set.load(path, options)
    problem = "is no driving clip of a known layout" if Path(path).is_dir() else "there is no such folder"
    layouts = "; ".join(f"{data_set.title}: {data_set.needs}" for data_set in DATA_SETS)
    raise DataError(path, problem, f"Give a folder that holds one of these. {layouts}")
