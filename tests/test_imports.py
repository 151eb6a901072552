"""Who imports whom: the contracts of pyproject.toml, and what they cannot say.

Imports inside functions count like all others; those for type checkers count for the contracts.
"""

import re
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST_ARROWS = {"instdrive_core.edits": 20, "instdrive_core.training": 55}
"""Upper bounds for the pairs of children of a room of which one imports the other."""
WITHOUT_TORCH = (
    "instdrive_core.formats.registry",
    "instdrive_core.edits.serialize",
    "instdrive_core.edits.queries.bake",
    "instdrive_core.rasterize.scene_view",
    "instdrive_core.project.open",
    "instdrive_core.project.recovery",
    "instdrive_core.masks.sam.labels",
    "instdrive_core.cli.apply",
    "instdrive_core.cli.render",
    "instdrive_core.cli.info",
    "instdrive_core.cli.objects",
    "instdrive_core.cli.id_masks",
    "instdrive_app.cli.edit",
)
"""What opening, editing and drawing import. In this order: the app comes last, as it may load what draws."""
DRAWING_MODULES = {"moderngl", "OpenGL", "glfw", "imgui_bundle"}


@pytest.fixture(scope="module")
def graph():
    """Every module of both packages and what it imports when it runs."""
    packages = ("instdrive_core", "instdrive_app")
    return grimp.build_graph(*packages, exclude_type_checking_imports=True, cache_dir=None)


def find_circle(edges):
    """The modules among `edges` (dict of sets) that lie on circles or between them, sorted."""
    remaining = {importer: set(imported) for importer, imported in edges.items()}
    while True:
        # A module that imports nothing that remains can be on no circle.
        kept = {importer: imported & remaining.keys() for importer, imported in remaining.items()}
        kept = {importer: imported for importer, imported in kept.items() if imported}
        if kept.keys() == remaining.keys():
            return sorted(remaining)
        remaining = kept


def arrows_between_children(graph, room):
    """Pairs (importer, imported) of direct children of a room."""
    depth = room.count(".") + 1

    def child(module):
        return module.split(".")[depth] if module.startswith(f"{room}.") else None

    pairs = {
        (child(module), child(imported))
        for module in graph.find_descendants(room)
        for imported in graph.find_modules_directly_imported_by(module)
    }
    return sorted((importer, imported) for importer, imported in pairs if imported and importer != imported)


def run_fresh(code):
    """What a fresh interpreter prints."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def modules_after(code):
    """Top-level names of what a fresh interpreter has loaded after `code`."""
    last = run_fresh(f"{code}\nimport sys; print(*sys.modules)").splitlines()[-1]
    return {name.split(".")[0] for name in last.split()}


def test_contracts_of_rooms_hold():
    """In a process of its own: the linter's configuration of logging switches off the loggers that there are."""
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command; lint_imports_command()"]
    done = subprocess.run([*command, "--no-cache", "--no-logo"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_circles_are_found():
    assert find_circle({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == ["a", "b", "c"]
    assert find_circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_no_modules_import_each_other_in_a_circle(graph):
    assert not find_circle({module: graph.find_modules_directly_imported_by(module) for module in graph.modules})


@pytest.mark.parametrize("room", MOST_ARROWS)
def test_rooms_inside_a_room_know_few_others(graph, room):
    arrows = arrows_between_children(graph, room)
    assert 0 < len(arrows) <= MOST_ARROWS[room], arrows


def test_benchmarks_are_imported_by_their_own_tests_only():
    pattern = re.compile(r"^\s*(from|import) benchmarks\b", re.MULTILINE)
    folders = [ROOT / "instdrive_core", ROOT / "app", ROOT / "tests"]
    files = [path for folder in folders for path in folder.rglob("*.py") if pattern.search(path.read_text("utf-8"))]
    assert {path.parent for path in files} == {ROOT / "tests" / "benchmarks"}


@pytest.fixture(scope="module")
def loaded():
    """Top-level names that are loaded after each of `WITHOUT_TORCH`, all imported by one process."""
    names = "print(*{name.split('.')[0] for name in sys.modules})"
    code = "import sys\n" + "\n".join(f"import {module}; {names}" for module in WITHOUT_TORCH)
    lines = run_fresh(code).splitlines()
    return {module: set(line.split()) for module, line in zip(WITHOUT_TORCH, lines, strict=True)}


@pytest.mark.parametrize("module", WITHOUT_TORCH)
def test_opening_editing_and_drawing_never_load_torch(loaded, module):
    assert not loaded[module] & {"torch", "cv2", "embreex", "pandas", "pycocotools", "skimage"}
    if module.startswith("instdrive_core"):
        assert not loaded[module] & DRAWING_MODULES


def test_help_loads_neither_numpy_nor_a_command():
    loaded = modules_after("from instdrive_app.main import main; assert main(['--help']) == 0")
    assert not loaded & {"numpy", "tyro", "numba", "torch", "instdrive_core"}


def test_the_entry_point_imports_the_standard_library_only():
    """So it starts at once: 20 ms, of which most is `dataclasses`."""
    loaded = modules_after("import instdrive_app.main") - modules_after("pass")
    assert loaded <= {*sys.stdlib_module_names, "instdrive_app"}
