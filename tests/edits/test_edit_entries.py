"""Edits as JSON: what is no edit is refused by name."""

import json
import subprocess
import sys

import pytest

from instdrive_core.edits.kinds.select import SelectNone
from instdrive_core.edits.serialize import edit_from_json, edits_from_lines
from instdrive_core.errors import EditError

BAD_ENTRIES = [
    ({"kind": "explode"}, "explode"),
    ({"kind": ["show_all"]}, "show_all"),
    (["delete_instances"], "delete_instances"),
    ({"kind": "delete_instances"}, "ids"),
    ({"kind": "delete_instances", "ids": [1], "force": True}, "force"),
    ({"kind": "delete_instances", "ids": ["1"]}, "'1'"),
    ({"kind": "delete_instances", "ids": [True]}, "True"),
    ({"kind": "delete_instances", "ids": [0]}, "ID 0"),
    ({"kind": "delete_instances", "ids": [[1]]}, "[1]"),
    ({"kind": "delete_instances", "ids": []}, "no instance"),
    ({"kind": "delete_instances", "ids": 3}, "delete_instances"),
    ({"kind": "select_instances", "ids": [1], "mode": "toggle"}, "toggle"),
    ({"kind": "select_codeword", "codeword": -1}, "-1"),
    ({"kind": "select_codeword", "codeword": 1 << 40}, "bits"),
    ({"kind": "select_class", "class_name": 4}, "4"),
    ({"kind": "select_rows", "rows": [0, 1]}, "pairs"),
    ({"kind": "select_rows", "rows": [[5, 1], [2, 1]]}, "rising"),
    ({"kind": "select_rows", "rows": 7}, "7"),
    ({"kind": "select_rows", "rows": [[0, 1]], "mode": "toggle"}, "toggle"),
    ({"kind": "grow_selection", "distance": 0}, "metres above 0"),
    ({"kind": "grow_selection", "distance": True}, "metres above 0"),
    ({"kind": "shrink_selection", "distance": "far"}, "'far'"),
    ({"kind": "shrink_selection", "time": None}, "seconds"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "glow", "color": [0, 0, 0]}, "glow"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "tint", "color": [0, 0]}, "three numbers"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "tint", "color": [0, 0, float("nan")]}, "three numbers"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "tint", "color": "red"}, "red"),
    ({"kind": "rename_instance", "id": 1, "name": 5}, "5"),
    ({"kind": "rename_instance", "id": None, "name": "x"}, "None"),
    ({"kind": "hide_instances", "ids": [1], "hidden": "yes"}, "yes"),
    ({"kind": "lock_instances", "ids": [1], "locked": 1}, "locked"),
    ({"kind": "split_instance", "id": 1, "gap": "wide"}, "wide"),
    ({"kind": "reassign_selected", "into": "1"}, "'1'"),
    ({"kind": "absorb_floaters", "id": 0}, "ID 0"),
    ({"kind": "move_instances", "ids": [1], "translation": [0, 0]}, "translation"),
    ({"kind": "move_instances", "ids": [1], "translation": [0, 0, "x"]}, "translation"),
    ({"kind": "move_instances", "ids": [1], "rotation": [0, 0, 0, 0]}, "rotation"),
    ({"kind": "move_instances", "ids": [1], "scale": 0}, "scale"),
    ({"kind": "move_instances", "ids": [1], "scale": float("nan")}, "scale"),
    ({"kind": "move_instances", "ids": [1], "on_ground": 1}, "on_ground"),
    ({"kind": "duplicate_instances", "ids": [1], "translation": None}, "duplicate"),
    ({"kind": "insert_scene", "path": 7}, "7"),
    ({"kind": "adjust_instances", "ids": [1], "what": "gloss", "amount": 1}, "gloss"),
    ({"kind": "adjust_instances", "ids": [1], "what": "hue", "amount": 181}, "181"),
    ({"kind": "adjust_instances", "ids": [1], "what": "opacity", "amount": 1.5}, "1.5"),
    ({"kind": "adjust_instances", "ids": [1], "what": "hue", "amount": "30"}, "30"),
    ({"kind": "compound", "edits": [{"kind": "explode"}], "name": "x"}, "explode"),
    ({"kind": "compound", "edits": 5, "name": "x"}, "compound"),
    ({"kind": "compound", "edits": [], "name": 5}, "5"),
]
REFUSE = """
import json, sys
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
for entry in json.load(sys.stdin):
    try:
        print(edit_from_json(entry))
    except EditError as error:
        print("refused:", str(error).replace(chr(10), " "))
"""


def test_entries_that_are_no_edits_are_refused_without_beartypes_help():
    entries = json.dumps([entry for entry, _ in BAD_ENTRIES])
    result = subprocess.run([sys.executable, "-c", REFUSE], input=entries, capture_output=True, text=True, check=True)
    for line, (entry, named) in zip(result.stdout.splitlines(), BAD_ENTRIES, strict=True):
        assert line.startswith("refused:"), (entry, line)
        assert named in line, (entry, line)


def test_bad_lines_are_numbered_and_nesting_is_bounded():
    good = json.dumps(SelectNone().to_json())
    assert edits_from_lines(f"\n{good}\n\n{good}\n") == [SelectNone(), SelectNone()]
    with pytest.raises(EditError, match="line 2"):
        edits_from_lines(f"{good}\n{{\n")
    nested = SelectNone().to_json()
    for _ in range(20):
        nested = {"kind": "compound", "edits": [nested], "name": "x"}
    with pytest.raises(EditError, match="nested"):
        edit_from_json(nested)
