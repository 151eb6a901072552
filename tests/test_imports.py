"""The direction of imports, as docs and layout promise it: lazy imports and those for type checkers count too."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CORE_LAYERS = [
    {"files", "maths"},
    {"instances"},
    {"scene"},
    {"formats", "datasets", "rasterize", "edits"},
    {"masks", "project"},
    {"tracks"},
    {"evaluation"},
    {"training"},
    {"baselines"},
    {"cli"},
]
"""A package imports from layers before its own, never from a sibling."""
APP_LAYERS = [
    {"state", "messages", "commands", "files"},
    {"camera", "jobs", "render"},
    {"session"},
    {"tools"},
    {"actions"},
    {"panels"},
    {"shell"},
    {"demo"},
    {"cli"},
    {"main"},
]
"""Modules that are not listed may stand anywhere as long as no circle arises."""
SESSION_LAYERS = [
    {"context", "kept", "export_kinds", "reference_pictures", "recents", "jumping", "autosave"},
    {"selection_box"},
    {"moving"},
    {"aftermath", "borders", "files", "inserting", "labels", "navigation", "solo"},
    {"exporting", "turning", "view_memory"},
    {"editor_session"},
]
PACKAGES = [
    ("instdrive_core", "instdrive_core", CORE_LAYERS),
    ("app", "instdrive_app", APP_LAYERS),
    ("app/session", "instdrive_app.session", SESSION_LAYERS),
]
GL_MODULES = {"moderngl", "OpenGL", "glfw"}
DRAWING_MODULES = GL_MODULES | {"imgui_bundle"}


def imported_names(path, package):
    """Dotted names of everything a file imports, relative imports resolved."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*package.split(".")[: -node.level + 1 or None]]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            yield from (f"{module}.{alias.name}" for alias in node.names)


def parts_and_imports(folder, package):
    """Pairs (part, imported dotted name) where a part is a direct child of the package."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        relative = path.relative_to(ROOT / folder)
        inner = ".".join([package, *relative.parts[:-1]])
        for name in imported_names(path, inner):
            yield relative.with_suffix("").parts[0], name


def graph(folder, package):
    """Which part imports which other part."""
    parts = {path.stem for path in (ROOT / folder).iterdir() if path.suffix == ".py" or path.is_dir()}
    edges = set()
    for part, name in parts_and_imports(folder, package):
        imported = name.removeprefix(f"{package}.").split(".")[0] if name.startswith(f"{package}.") else ""
        if imported in parts and imported != part:
            edges.add((part, imported))
    return edges


def layer_of(part, layers):
    return next((rank for rank, layer in enumerate(layers) if part in layer), None)


@pytest.mark.parametrize(("folder", "package", "layers"), PACKAGES)
def test_imports_go_down_the_layers_only(folder, package, layers):
    wrong = []
    for importer, imported in sorted(graph(folder, package)):
        above, below = layer_of(importer, layers), layer_of(imported, layers)
        if above is not None and below is not None and above <= below:
            wrong.append(f"{importer} imports {imported}")
    assert not wrong


@pytest.mark.parametrize(("folder", "package"), [pair[:2] for pair in PACKAGES])
def test_no_circles(folder, package):
    remaining = graph(folder, package)
    while remaining:
        # Edges to parts that import nothing more can be in no circle.
        importers = {importer for importer, _ in remaining}
        kept = {edge for edge in remaining if edge[1] in importers}
        assert kept != remaining, f"circle among {sorted(kept)}"
        remaining = kept


def packages_in(folder):
    return {path.name for path in (ROOT / folder).iterdir() if (path / "__init__.py").is_file()}


@pytest.mark.parametrize(("folder", "package", "layers"), PACKAGES)
def test_every_package_has_its_layer(folder, package, layers):
    assert packages_in(folder) <= set().union(*layers)


@pytest.mark.parametrize(("folder", "package", "layers"), PACKAGES)
def test_layers_name_what_there_is(folder, package, layers):
    assert set().union(*layers) <= {path.stem for path in (ROOT / folder).iterdir()}


def test_what_all_of_the_core_may_use_uses_none_of_it():
    """Errors, progress, wording and the like lie below every package."""
    packages = packages_in("instdrive_core")
    edges = graph("instdrive_core", "instdrive_core")
    assert not [edge for edge in edges if edge[0] not in packages and edge[1] in packages]


def test_core_knows_no_window_and_no_app():
    seen = {(part, name) for part, name in parts_and_imports("instdrive_core", "instdrive_core")}
    assert not {pair for pair in seen if pair[1].split(".")[0] in DRAWING_MODULES | {"instdrive_app"}}


def test_only_window_and_render_touch_gl():
    touching = {part for part, name in parts_and_imports("app", "instdrive_app") if name.split(".")[0] in GL_MODULES}
    assert touching <= {"shell", "render"}


def test_torch_is_imported_in_training_and_for_segment_anything_only():
    seen = {
        part for part, name in parts_and_imports("instdrive_core", "instdrive_core") if name.split(".")[0] == "torch"
    }
    assert seen <= {"training", "baselines", "cli", "masks"}
    for path in (ROOT / "instdrive_core" / "masks").rglob("*.py"):
        names = {name.split(".")[0] for name in imported_names(path, "instdrive_core.masks")}
        assert path.parent.name == "sam" or "torch" not in names, path.name
    assert not [name for _, name in parts_and_imports("app", "instdrive_app") if name.split(".")[0] == "torch"]


def modules_after(code):
    result = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return {name.split(".")[0] for name in result.stdout.splitlines()[-1].split()}


@pytest.mark.parametrize(
    "module",
    [
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
    ],
)
def test_opening_editing_and_drawing_never_load_torch(module):
    loaded = modules_after(f"import {module}")
    assert "torch" not in loaded
    if module.startswith("instdrive_core"):
        assert not loaded & DRAWING_MODULES


def test_help_loads_neither_numpy_nor_a_command():
    loaded = modules_after("from instdrive_app.main import main; assert main(['--help']) == 0")
    assert not loaded & {"numpy", "tyro", "numba", "torch", "instdrive_core"}
