"""Whether a scene was trained with antialiasing: read as other programs say it, kept by every format with a place."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from random_scene import random_scene
from sog_files import files_of, meta_of, random_bytes, write_archive, write_folder

from instdrive_core.cli.convert import convert
from instdrive_core.cli.info import print_info
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.spz.scenes import write_spz


def scene_of(antialiased: bool):
    scene = random_scene(count=50, actors=0)
    scene.antialiased = antialiased
    return scene


@pytest.mark.parametrize("name", ["a.ply", "a.compressed.ply", "a.spz", "folder"])
@pytest.mark.parametrize("antialiased", [False, True])
def test_the_mark_is_kept(tmp_path: Path, name: str, antialiased: bool) -> None:
    save_scene(tmp_path / name, scene_of(antialiased))
    assert open_scene(tmp_path / name).antialiased is antialiased


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_spz_files_have_it_as_the_lowest_flag(tmp_path: Path, version: int) -> None:
    path = tmp_path / "a.spz"
    write_spz(path, scene_of(True), version)
    assert open_scene(path).antialiased
    if version == 4:
        assert struct.unpack_from("<4sIIBBB", path.read_bytes())[-1] == 1


@pytest.mark.parametrize(
    ("comments", "expected"),
    [
        (["SplatRenderMode: mip"], True),
        (["SplatRenderMode mip"], True),
        (["  SPLATRENDERMODE:\t Mip "], True),
        (["antialiased 1"], True),
        (["antialiased: 1"], True),
        (["Exported from another program", "antialiased 1", "SH degree: 3"], True),
        (["SplatRenderMode: mip", "antialiased 0"], False),
        (["antialiased 1", "SplatRenderMode: default"], False),
        (["SplatRenderMode: 2dgs"], False),
        (["not SplatRenderMode: mip"], False),
    ],
)
@pytest.mark.parametrize("name", ["a.ply", "a.compressed.ply"])
def test_comments_of_other_programs(tmp_path: Path, name: str, comments: list[str], expected: bool) -> None:
    path = tmp_path / name
    save_scene(path, scene_of(False))
    lines = "".join(f"comment {comment}\n" for comment in comments).encode()
    path.write_bytes(path.read_bytes().replace(b"element ", lines + b"element ", 1))
    assert open_scene(path).antialiased is expected


@pytest.mark.parametrize("mark", [{"antialias": True}, {"model": "antialiased"}, {}, {"antialias": False}])
def test_sog(tmp_path: Path, mark: dict) -> None:
    rng = np.random.default_rng(0)
    content, meta = random_bytes(rng, 40), meta_of(rng, 40) | mark
    files = files_of(content, meta)
    write_archive(tmp_path / "a.sog", files)
    write_folder(tmp_path / "levels" / "0_0", files)
    write_folder(tmp_path / "levels" / "0_1", files)
    expected = bool(mark) and mark != {"antialias": False}
    assert open_scene(tmp_path / "a.sog").antialiased is expected
    assert open_scene(tmp_path / "levels").antialiased is expected


def test_folders_from_before_are_plain_and_other_values_are_refused(tmp_path: Path) -> None:
    save_scene(tmp_path, scene_of(True))
    path = tmp_path / "scene.json"
    manifest = json.loads(path.read_text())
    path.write_text(json.dumps({key: value for key, value in manifest.items() if key != "antialiased"}))
    assert not open_scene(tmp_path).antialiased
    path.write_text(json.dumps(manifest | {"antialiased": "no"}))
    with pytest.raises(DataError, match="antialiased"):
        open_scene(tmp_path)


def test_info_and_convert_say_so(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    save_scene(tmp_path / "a.spz", scene_of(True))
    print_info(tmp_path / "a.spz")
    assert "antialiased" in capsys.readouterr().out
    convert(tmp_path / "a.spz", tmp_path / "b.ply")
    assert "antialiased" not in capsys.readouterr().out
    convert(tmp_path / "a.spz", tmp_path / "b.splat")
    assert "antialiased" in capsys.readouterr().out
