"""Files are read again before they take the place of others."""

import dataclasses
import re

import numpy as np
import pytest
from random_scene import assert_same_scene, random_gaussians, random_scene

from instdrive_core.errors import DataError
from instdrive_core.formats import registry
from instdrive_core.formats.ply.compare import find_changed_value
from instdrive_core.formats.read_back import find_loss, save_and_verify
from instdrive_core.formats.registry import FORMATS, open_scene, save_scene
from instdrive_core.progress import CancelledError, report_to
from instdrive_core.scene.scene import scene_from_gaussians

WRITTEN = [fmt for fmt in FORMATS if fmt.write is not None]
NAMES = [f"street{fmt.suffix}" for fmt in WRITTEN]


def format_named(suffix):
    return next(fmt for fmt in FORMATS if fmt.suffix == suffix)


def static_scene(seed=0, count=700):
    return dataclasses.replace(random_scene(seed, count, actors=0), sky=None, views=())


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("extent", [1e-3, 30.0, 5e4])
def test_what_is_written_passes(tmp_path, name, extent):
    gaussians = random_gaussians(np.random.default_rng(1), 900, degree=2, features=0)
    gaussians.means *= np.float32(extent)
    scene = scene_from_gaussians(gaussians)
    save_and_verify(tmp_path / name, scene)
    save_scene(tmp_path / f"plain_{name}", scene)
    assert len(open_scene(tmp_path / name)) == 900
    if (tmp_path / name).is_file():
        assert (tmp_path / name).read_bytes() == (tmp_path / f"plain_{name}").read_bytes()


def test_folders_are_checked_with_all_they_keep(tmp_path):
    scene = random_scene()
    save_and_verify(tmp_path / "run", scene)
    assert_same_scene(open_scene(tmp_path / "run"), scene)


def test_numbers_that_are_none_are_kept_where_the_format_keeps_them(tmp_path):
    scene = static_scene()
    scene.gaussians.means[3] = np.nan
    scene.gaussians.log_scales[5] = -np.inf
    for name in ("a.ply", "a.splat", "a"):
        save_and_verify(tmp_path / name, scene)
        assert np.isnan(open_scene(tmp_path / name).gaussians.means[3]).all()


DAMAGES = {
    "a splat short": lambda g: g.select(np.arange(len(g) - 1)),
    "a position off": lambda g: dataclasses.replace(g, means=g.means + np.eye(len(g), 3, dtype=np.float32)),
    "a rotation lost": lambda g: dataclasses.replace(g, quats=np.where(np.eye(len(g), 4) > 0, np.nan, g.quats)),
}
TOLD = {
    "a splat short": "699 splats came back of 700",
    "a position off": "of splat",
    "a rotation lost": r"(quats|rot_0) of splat",
}


@pytest.mark.parametrize("suffix", [fmt.suffix for fmt in WRITTEN])
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_file_that_reads_differently_replaces_nothing(tmp_path, monkeypatch, suffix, damage):
    path, scene, old = tmp_path / f"street{suffix}", static_scene(), static_scene(7, 50)
    save_scene(path, old)
    before = sorted(file.name for file in tmp_path.rglob("*"))
    fmt = format_named(suffix)

    def broken(found):
        gaussians = DAMAGES[damage](found.gaussians)
        gaussians.quats = gaussians.quats.astype(np.float32)
        rows = np.arange(len(gaussians))
        columns = {name: getattr(found, name)[rows] for name in ("instance_ids", "codewords", "nodes")}
        extra = {name: column[rows] for name, column in found.extra.items()}
        return dataclasses.replace(found, gaussians=gaussians, **columns, extra=extra)

    def damaged(*where):
        return broken(fmt.read(*where))

    at_fault = dataclasses.replace(fmt, read=damaged)
    if fmt.fidelity.find_change is not None:  # such a format's files are not read by its reader
        at_fault = dataclasses.replace(fmt, write=lambda path, scene: fmt.write(path, broken(scene)))
    replaced = [at_fault if other is fmt else other for other in FORMATS]
    monkeypatch.setattr(registry, "FORMATS", tuple(replaced))
    with pytest.raises(DataError, match="Nothing was replaced") as caught:
        save_and_verify(path, scene)
    assert caught.value.path == path
    assert re.search(TOLD[damage], str(caught.value))
    monkeypatch.undo()
    assert len(open_scene(path)) == 50
    assert sorted(file.name for file in tmp_path.rglob("*")) == before


@pytest.mark.parametrize("flip", [1, 1 << 23])
def test_a_ply_with_one_bit_off_is_told(tmp_path, flip):
    path, scene = tmp_path / "a.ply", static_scene()
    scene.gaussians.log_scales[3] = np.nan
    save_scene(path, scene)
    assert find_changed_value(path, scene) == ""
    scene.gaussians.sh_rest[650, 2, 1:2].view(np.uint32)[0] ^= flip
    assert find_changed_value(path, scene).startswith("f_rest_17 of splat 650 is ")


def test_a_ply_with_other_columns_is_told(tmp_path):
    path, scene = tmp_path / "a.ply", static_scene()
    save_scene(path, dataclasses.replace(scene, extra={"weight": np.ones(len(scene), np.float32)}))
    scene.extra = {}
    assert "weight" in find_changed_value(path, scene)


@pytest.mark.parametrize("suffix", [".spz", ".compressed.ply", ".splat", ".ply"])
def test_the_splat_that_moved_is_named_by_its_row(tmp_path, suffix):
    scene, fmt = static_scene(), format_named(suffix)
    path = tmp_path / f"a{suffix}"
    save_scene(path, scene)
    found = fmt.read(path)
    assert find_loss(scene, found, fmt.fidelity) == ""
    moved = int(np.abs(found.gaussians.means - scene.gaussians.means[250]).sum(axis=1).argmin())
    found.gaussians.means[moved, 1] += 0.1
    told = find_loss(scene, found, fmt.fidelity)
    assert "splat 250 is" in told
    if suffix != ".ply":
        assert told.startswith("y of splat")


def test_cancelling_while_reading_keeps_the_old_file(tmp_path):
    path = tmp_path / "a.ply"
    save_scene(path, static_scene(7, 50))
    shares = []

    def stop_late(share):
        shares.append(share)
        if share > 0.6:
            raise CancelledError("enough")

    with report_to(stop_late), pytest.raises(CancelledError):
        save_and_verify(path, static_scene(count=30_000))
    assert shares == sorted(shares)
    assert len(open_scene(path)) == 50
    assert [file.name for file in tmp_path.iterdir()] == ["a.ply"]
