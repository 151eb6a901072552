"""`instdrive convert` as a user calls it."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.fixture
def run(tmp_path):
    """A run folder with two moving actors and eight instances."""
    save_scene(tmp_path / "run", random_scene())
    return tmp_path / "run"


def test_a_run_becomes_files_and_says_what_they_cannot_hold(run, tmp_path, capsys):
    frozen = freeze_at_time(random_scene(), 0.3)
    expected = {
        "a.ply": (["5 photo cameras", "sky"], ["SH degree", "instances", "origin"]),
        "a.compressed.ply": (["8 instances", "4 features", "confidence", "sky"], ["SH degree", "origin"]),
        "a.splat": (["8 instances", "SH degree 3", "the origin"], []),
    }
    for name, (lost, kept) in expected.items():
        assert main(["convert", str(run), str(tmp_path / name), "--time", "0.3"]) == 0
        text = capsys.readouterr().out
        assert f"{name}: {len(frozen)} splats" in text
        assert all(word in text for word in lost)
        assert not any(word in text for word in kept)
        assert len(open_scene(tmp_path / name)) == len(frozen)
    by_place = [np.sort(open_scene(tmp_path / name).gaussians.means, axis=0) for name in expected]
    np.testing.assert_array_equal(by_place[0], by_place[2])
    np.testing.assert_allclose(by_place[0], by_place[1], atol=0.02)


def test_without_a_time_it_says_which_moment_it_took(run, tmp_path, capsys):
    assert main(["convert", str(run), str(tmp_path / "a.splat")]) == 0
    text = capsys.readouterr().out
    assert "at 0 s" in text
    absent = len(random_scene()) - len(open_scene(tmp_path / "a.splat"))
    assert absent > 0
    assert f"{absent} splats of objects that are not there at that time are left out" in text


def test_a_folder_loses_nothing_and_says_nothing(run, tmp_path, capsys):
    assert main(["convert", str(run), str(tmp_path / "copy")]) == 0
    assert "left out" not in capsys.readouterr().out
    assert len(open_scene(tmp_path / "copy").actors) == 2


def test_info_and_apply_take_the_new_formats(run, tmp_path, capsys):
    for name in ("b.compressed.ply", "b.splat"):
        assert main(["apply", str(run), "--delete", "1", "-o", str(tmp_path / name)]) == 0
        assert main(["info", str(tmp_path / name)]) == 0
        assert "instances:    0, on 0 splats" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [("absent.splat", "b.ply", "no such file"), ("run", "b.obj", "'.obj'"), ("broken.splat", "b.ply", "31 bytes")],
)
def test_what_cannot_be_converted_is_explained(run, tmp_path, capsys, source, target, message):
    (tmp_path / "broken.splat").write_bytes(bytes(31))
    assert main(["convert", str(tmp_path / source), str(tmp_path / target)]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / target).exists()


def test_an_empty_name_does_not_mean_this_folder(run, tmp_path, capsys, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for arguments in (["convert", str(run), ""], ["apply", str(run), "--delete", "1", "-o", ""]):
        assert main(arguments) == 2
        assert "an argument is empty" in capsys.readouterr().err
    assert list((tmp_path / "here").iterdir()) == []
    assert main(["convert", str(run), "."]) == 0
    assert (tmp_path / "here" / "scene.json").is_file()
