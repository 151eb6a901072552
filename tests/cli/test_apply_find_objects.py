"""``instdrive apply --find-objects`` makes instances that later options of the same command can name."""

import numpy as np
import pytest
from edit_cases import rich_document

from instdrive_app.main import main
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.instances.table import InstanceTable


@pytest.fixture
def lying(tmp_path):
    """A file without instances whose y points down."""
    scene = bake_document(rich_document(), 0.0)
    scene.instance_ids = np.zeros(len(scene), np.uint32)
    scene.table = InstanceTable()
    document = Document(scene)
    document.apply(TurnScene((0.5**0.5, 0.5**0.5, 0.0, 0.0), 4.0))
    path = tmp_path / "lying.ply"
    save_scene(path, bake_document(document, 0.0))
    return path


def test_objects_are_found_after_turning_and_can_be_deleted(lying, tmp_path, capsys):
    out, fewer = tmp_path / "out.ply", tmp_path / "fewer.ply"
    turn = ["--up", "-y"]
    assert main(["apply", str(lying), *turn, "--find-objects", "-o", str(out)]) == 0
    assert "found: " in capsys.readouterr().out
    found = open_scene(out)
    assert main(["apply", str(lying), *turn, "-o", str(tmp_path / "upright.ply")]) == 0
    assert main(["apply", str(tmp_path / "upright.ply"), "--find-objects", "-o", str(tmp_path / "twice.ply")]) == 0
    np.testing.assert_array_equal(open_scene(tmp_path / "twice.ply").instance_ids, found.instance_ids)
    first = next(iter(found.table))
    assert main(["apply", str(lying), *turn, "--find-objects", "--delete", str(first.id), "-o", str(fewer)]) == 0
    assert len(open_scene(fewer)) == len(found) - first.count
