"""After warming up, no first click, sort, region or growing loads a kernel; in a process where none is loaded."""

import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[2] / "support"

SCRIPT = """
import numpy as np
from random_scene import random_scene
from instdrive_app.render.depth_order import sort_by_depth
from instdrive_app.render.picking import Picker
from instdrive_app.render.warm_up import warm_up
from instdrive_app.state import EditorState, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.grow import GrowSelection, ShrinkSelection
from instdrive_core.edits.queries.region import find_rows_in_region
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.instances import neighbors, proximity
from instdrive_core.maths import sorting
from instdrive_core.rasterize import edited_rows, pixel_contributors
from instdrive_core.rasterize.kernels import project
from instdrive_core.scene import screen_region

modules = (sorting, pixel_contributors, project, edited_rows, proximity, neighbors, screen_region)
kernels = [kernel for module in modules for kernel in vars(module).values() if hasattr(kernel, "signatures")]
assert not any(kernel.signatures for kernel in kernels)
warm_up()
loaded = sum(len(kernel.signatures) for kernel in kernels)
document = Document(random_scene())
Picker().find_instances_at(document, resolve(EditorState(), 640, 360), 320.0, 180.0)
sort_by_depth("key", document.scene.gaussians.means, np.array([0, 1, 0, 3], np.float32), 0.2)
find_rows_in_region(document, resolve(EditorState(), 64, 36).camera, 0.0, np.ones((36, 64), bool))
document.apply(SelectRows(np.arange(10)))
document.apply(GrowSelection(0.5))
document.apply(ShrinkSelection())
print(loaded, sum(len(kernel.signatures) for kernel in kernels))
"""


def test_the_first_click_and_sort_load_nothing():
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(TESTS)!r})\n{SCRIPT}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    before, after = done.stdout.split()
    assert int(before) == int(after) >= 7
