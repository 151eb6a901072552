"""The worked examples of CONTRIBUTING.md run, and fit into the registries that they are for."""

import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from edit_cases import SIGN, rich_document

from instdrive_app.main import COMMANDS
from instdrive_core.scene.selection import Flag

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
HEADINGS = re.compile(r"^### An? (.+)$", re.MULTILINE)
SECTIONS = HEADINGS.split(TEXT)[1:]
EXAMPLES = {
    name: re.findall(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL)[0]
    for name, section in zip(SECTIONS[::2], SECTIONS[1::2], strict=True)
}
"""Code by heading."""


def run_example(name, monkeypatch):
    """What the example of this heading defines."""
    module = types.ModuleType(f"example_of_{name.replace(' ', '_')}")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(EXAMPLES[name], f"CONTRIBUTING.md: {name}", "exec"), vars(module))
    return module


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(name, monkeypatch):
    run_example(name, monkeypatch)


def test_the_format_reads(monkeypatch, tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 0\n1 2 3\n")
    scene = run_example("scene format", monkeypatch).XYZ.read(tmp_path / "a.xyz")
    np.testing.assert_array_equal(scene.gaussians.means, [[0, 0, 0], [1, 2, 3]])


def test_the_edit_is_done_and_undone(monkeypatch):
    document, edit = rich_document(), run_example("edit", monkeypatch).UnlockAll()
    locked = document.state.find_rows(Flag.LOCKED)
    document.apply(edit)
    assert not len(document.state.find_rows(Flag.LOCKED))
    document.undo()
    np.testing.assert_array_equal(document.state.find_rows(Flag.LOCKED), locked)
    assert (document.scene.instance_ids[locked] == SIGN).all()


def test_places_that_are_named_are_there():
    named = re.findall(r"`((?:instdrive_core|app|tests|docs|benchmarks)/[\w/.]+)`", TEXT)
    assert not [path for path in named if not (ROOT / path).exists()]
    for path in re.findall(r"`([a-z]\w*/(?:\w+/)*\w+\.py)`", TEXT):
        assert any((ROOT / base / path).exists() for base in ("", "instdrive_core", "app")), path


def test_the_new_command_is_none_yet():
    assert "count" not in COMMANDS
