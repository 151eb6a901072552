"""Scenes stood upright with `instdrive apply`."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.scene_up import estimate_document_up
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project.open import open_document
from instdrive_core.scene.scene import scene_from_gaussians


@pytest.fixture
def run(tmp_path):
    """A run folder with two moving actors, cameras and a sky."""
    save_scene(tmp_path / "run", random_scene())
    return tmp_path / "run"


@pytest.mark.parametrize("words", [["--up", "-y"], ["--up=-Y"], ["--up", "0,-3,0"]])
def test_a_file_with_y_down_comes_out_upright(run, tmp_path, words):
    assert main(["apply", str(run), *words, "-o", str(tmp_path / "out")]) == 0
    before, after = random_scene(), open_scene(tmp_path / "out")
    still = before.nodes == 0
    expected = before.gaussians.means[still] @ np.float32([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_array_equal(after.gaussians.means[still], expected)
    for old, new in zip(before.views, after.views, strict=True):
        np.testing.assert_allclose(new.camera.position, old.camera.position[[0, 2, 1]] * [1, 1, -1])


def test_other_edits_are_done_in_the_upright_scene(run, tmp_path):
    words = ["--scale", "0.5", "--move", "2=0,0,1", "-o", str(tmp_path / "out.instdrive")]
    assert main(["apply", str(run), *words, "--up", "y"]) == 0
    document, _ = open_document(tmp_path / "out.instdrive")
    assert [edit.kind for edit in document.history.done] == ["turn_scene", "move_instances"]
    rows, stored = document.find_rows((2,)), random_scene().gaussians.means
    np.testing.assert_allclose(document.compute_means(rows)[:, 2], stored[rows, 1] * 0.5 + 1, atol=1e-5)


def test_a_guess_says_how_it_is_known(run, tmp_path, capsys):
    assert main(["apply", str(run), "--up", "auto", "-o", str(tmp_path / "out")]) == 0
    assert "from the photos' cameras" in capsys.readouterr().out
    save_scene(tmp_path / "blob.spz", scene_from_gaussians(random_scene().gaussians))
    assert main(["apply", str(tmp_path / "blob.spz"), "--up", "auto", "-o", str(tmp_path / "out.ply")]) == 0
    assert "up: −Y, known from the file's format" in capsys.readouterr().out
    assert main(["apply", str(tmp_path / "out.ply"), "--up", "auto", "-o", str(tmp_path / "again.ply")]) == 0
    assert "up: −Y, a guess" in capsys.readouterr().out


@pytest.mark.parametrize("words", ["up", "1,2", "0,0,0", "nan,0,1", ""])
def test_what_is_no_direction_is_refused(run, tmp_path, capsys, words):
    assert main(["apply", str(run), f"--up={words}", "-o", str(tmp_path / "out")]) == 2
    assert "--up" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_up_is_guessed_for_what_the_edits_made_of_a_scene():
    document = Document(random_scene())
    document.apply(TurnScene.make_upright((0.0, -1.0, 0.0)))
    assert (
        estimate_document_up(document).axis == estimate_document_up(Document(bake_document(document))).axis == "+y"
    ), "its cameras stood upright before"
    bare = Document(scene_from_gaussians(random_scene().gaussians))
    assert estimate_document_up(bare, "-y").confident
    bare.apply(TurnScene.make_upright((0.0, -1.0, 0.0)))
    assert (estimate_document_up(bare, "-y").axis, estimate_document_up(bare, "-y").confident) == ("+z", False)
