"""What every scene format promises, checked for each entry of the registry: a new one is covered once it is listed."""

import contextlib
import dataclasses

import laspy
import numpy as np
import pytest
from random_scene import random_scene
from sog_files import files_of, meta_of, random_bytes, write_folder

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import ReadOptions
from instdrive_core.formats.checkpoints.records import CHECKPOINT_CKPT, CHECKPOINT_PT, CHECKPOINT_PTH
from instdrive_core.formats.checkpoints.sample_files import (
    build_captured_content,
    build_gsplat_content,
    build_splatfacto_content,
    write_checkpoint,
    write_training_folder,
)
from instdrive_core.formats.checkpoints.training_folder import TRAINING_FOLDER
from instdrive_core.formats.clouds.records import LAS, LAZ, PCD
from instdrive_core.formats.clouds.sample_files import build_pcd
from instdrive_core.formats.ksplat.sample_files import build_ksplat
from instdrive_core.formats.ksplat.scenes import KSPLAT
from instdrive_core.formats.lcc.sample_files import build_lcc, write_lcc
from instdrive_core.formats.lcc.scenes import LCC
from instdrive_core.formats.read_back import find_loss, save_and_verify
from instdrive_core.formats.registry import (
    FORMATS,
    find_format,
    find_format_to_write,
    find_stated_up,
    is_scene_folder,
    open_scene,
    save_scene,
)
from instdrive_core.formats.scene_files import identify_scene, list_scene_files
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.up_estimate import estimate_up
from instdrive_core.scene.upright import AXES

COUNT = 700
IDS = [fmt.suffix or "folder" for fmt in FORMATS]


def still_scene(seed=0, count=COUNT) -> Scene:
    return dataclasses.replace(random_scene(seed, count, actors=0), sky=None, views=())


def sog_files():
    rng = np.random.default_rng(0)
    meta = meta_of(rng, COUNT)
    return files_of(random_bytes(rng, COUNT), meta)


def checkpoint_writer(name, content):
    return lambda folder: write_checkpoint(folder / name, content(np.random.default_rng(0), COUNT))


def write_ksplat(folder):
    (folder / "street.ksplat").write_bytes(build_ksplat(np.random.default_rng(0), [(COUNT - 90, 2), (90, 1)]))


def write_las(folder, name):
    data = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    data.header.scales = [0.001] * 3
    data.x, data.y, data.z = np.random.default_rng(0).normal(0, 9, (3, COUNT))
    data.write(str(folder / name))


def write_pcd(folder):
    rng = np.random.default_rng(0)
    points, colors = rng.normal(0, 9, (COUNT, 3)), rng.integers(0, 255, (COUNT, 3))
    (folder / "street.pcd").write_bytes(build_pcd(points, colors, "binary_compressed"))


SAMPLES = {
    LAS.title: lambda folder: write_las(folder, "street.las"),
    LAZ.title: lambda folder: write_las(folder, "street.laz"),
    PCD.title: write_pcd,
    KSPLAT.title: write_ksplat,
    LCC.title: lambda folder: write_lcc(folder / "street", build_lcc(np.random.default_rng(0), (COUNT - 100, 100))),
    CHECKPOINT_PTH.title: checkpoint_writer("street.pth", build_captured_content),
    CHECKPOINT_PT.title: checkpoint_writer("street.pt", build_gsplat_content),
    CHECKPOINT_CKPT.title: checkpoint_writer("street.ckpt", build_splatfacto_content),
    TRAINING_FOLDER.title: lambda folder: write_training_folder(
        folder / "street", lambda path: save_scene(path, still_scene())
    ),
}
"""How a format that the program does not write comes by a file: a new one needs an entry."""
PATHS = {TRAINING_FOLDER.title: "street", LCC.title: "street", KSPLAT.title: "street.ksplat"}
PATHS |= {fmt.title: f"street{fmt.suffix}" for fmt in (CHECKPOINT_PTH, CHECKPOINT_PT, CHECKPOINT_CKPT, LAS, LAZ, PCD)}


def name_file(fmt, folder):
    """A path to be written: a street of its ending, or its whole name in a folder of the street's."""
    return (
        folder / f"street{fmt.suffix}"
        if fmt.suffix.startswith(".") or not fmt.suffix
        else folder / "street" / fmt.suffix
    )


def sample(fmt, folder):
    """Path of a scene of this format, written below `folder`."""
    if fmt.write is not None:
        path = name_file(fmt, folder)
        fmt.write(path, still_scene())
        return path.parent if path.name == fmt.suffix else path
    SAMPLES[fmt.title](folder)
    return folder / PATHS[fmt.title]


def list_read_files(path):
    """The files of a scene that opening reads: of levels of detail, those of the finest."""
    return [file for file in list_scene_files(path) if file.parent.name not in ("1_0", "2_0", "3_0")]


@pytest.fixture(params=FORMATS, ids=IDS)
def fmt(request):
    return request.param


def test_titles_and_endings_are_different():
    assert len({fmt.title for fmt in FORMATS}) == len({fmt.suffix for fmt in FORMATS}) == len(FORMATS)
    assert all(fmt.suffix == fmt.suffix.lower() for fmt in FORMATS)


def test_files_are_recognised(fmt, tmp_path):
    path = sample(fmt, tmp_path)
    assert find_format(path) is fmt
    assert is_scene_folder(path) == path.is_dir() == (fmt.folder is not None)
    assert len(open_scene(path)) == COUNT
    if fmt.suffix:
        assert find_format(tmp_path / f"OTHER{fmt.suffix.upper()}") is fmt


def test_what_was_written_opens_within_its_fidelity(fmt, tmp_path):
    if fmt.write is None:
        with pytest.raises(DataError, match=r"can be opened but not written\. Save as one of"):
            find_format_to_write(tmp_path / f"street{fmt.suffix}")
        return
    path, scene = name_file(fmt, tmp_path), still_scene()
    assert find_format_to_write(path)[0] is fmt
    save_and_verify(path, scene)
    assert find_loss(scene, open_scene(path), fmt.fidelity) == ""
    off = open_scene(path)
    off.gaussians.means[0] += 1
    assert "splat" in find_loss(scene, off, fmt.fidelity)


def test_every_second_splat_is_read(fmt, tmp_path):
    path = sample(fmt, tmp_path)
    every, second = fmt.read(path), fmt.read(path, options=ReadOptions(2))
    for name, array in second.gaussians.arrays().items():
        assert array.tobytes() == getattr(every.gaussians, name)[::2].tobytes(), name


def test_every_file_of_a_scene_is_listed_and_counts(fmt, tmp_path):
    path = sample(fmt, tmp_path)
    files, before = list_scene_files(path), identify_scene(path)
    assert sorted(files) == sorted(file for file in (path.rglob("*") if path.is_dir() else [path]) if file.is_file())
    assert before.size == sum(file.stat().st_size for file in files)
    for file in files:
        content = file.read_bytes()
        file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
        with contextlib.suppress(DataError):  # the file that names the others may be unreadable now
            assert identify_scene(path) != before, file
        file.write_bytes(content)
    assert identify_scene(path) == before


def test_files_cut_off_are_refused_by_name(fmt, tmp_path):
    path = sample(fmt, tmp_path)
    for file in list_read_files(path):
        content = file.read_bytes()
        file.write_bytes(content[: len(content) // 2 + 1])
        with pytest.raises(DataError) as caught:
            open_scene(path)
        assert path == caught.value.path or path in caught.value.path.parents
        file.write_bytes(content)
    assert len(open_scene(path)) == COUNT


def test_a_missing_file_is_refused_by_name(fmt, tmp_path):
    path = sample(fmt, tmp_path)
    for file in list_read_files(path):
        content = file.read_bytes()
        file.unlink()
        with pytest.raises(DataError, match=path.name):
            open_scene(path)
        file.write_bytes(content)


def test_the_stated_axis_is_believed(fmt, tmp_path):
    assert fmt.up is None or fmt.up in AXES
    if fmt.suffix:
        path = tmp_path / f"a{fmt.suffix}"
        assert find_stated_up(path) == fmt.up
        bare = still_scene()
        bare.table.instances.clear()
        found = estimate_up(bare, find_stated_up(path))
        assert found.confident == (fmt.up is not None)
        assert fmt.up is None or found.axis == fmt.up


def test_a_written_format_must_say_what_it_keeps():
    with pytest.raises(ValueError, match="must say what it keeps"):
        Format("Silent", ".silent", FORMATS[0].read, FORMATS[0].write)
    with pytest.raises(ValueError, match="must say what it keeps"):
        Format("Boastful", ".boast", FORMATS[0].read, None, Fidelity())


def test_a_level_list_is_known_by_itself(tmp_path):
    """Projects of version 0.1.0 recorded a scene opened through its lod-meta.json so."""
    path = tmp_path / "lod-meta.json"
    path.write_text("{}")
    (tmp_path / "other.webp").write_bytes(b"x")
    assert list_scene_files(path) == (path,)


def test_a_folder_of_two_formats_is_the_programs_own(tmp_path):
    path = tmp_path / "street"
    write_folder(path, sog_files())
    save_scene(path, still_scene(count=5))
    assert len(open_scene(path)) == 5
