"""What keeps the house readable: small folders, one name for one thing, docstrings that stand alone."""

import ast
import builtins
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"instdrive_core": "instdrive_core", "app": "instdrive_app"}
"""Folder and import name of what is installed."""
TREES = (*PACKAGES, "benchmarks", "tests", "examples")
MOST_MODULES = 25
MOST_SHARED_NAMES = 15
TRAINING_OPERATIONS = "instdrive_core.training.backends"
CONTRACTS = {
    "a differentiable operation in Numba and its twin in torch, which gsplat's backend uses and tests compare with": {
        f"{TRAINING_OPERATIONS}.{module}"
        for module in ("autograd", "exposure_op", "losses", "photometric", "placement", "sky_blend", "torch_ops")
    },
    "COLMAP's model in text and in binary files": {
        f"instdrive_core.datasets.colmap.{module}" for module in ("binary", "text")
    },
    "the actions of one menu": {
        f"instdrive_app.actions.{path.stem}" for path in (ROOT / "app" / "actions").glob("*.py")
    },
}
"""What functions of one name in several modules have promised alike, and the modules that do."""
LEANING = re.compile(r"\s*(Of|As|Into|The same)\b")


def python_files(tree):
    return sorted(path for path in (ROOT / tree).rglob("*.py") if "__pycache__" not in path.parts)


def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def public_names():
    """Public functions and classes at the top of a module, each with the modules that define it."""
    found = defaultdict(set)
    for folder, package in PACKAGES.items():
        for path in python_files(folder):
            module = ".".join([package, *path.relative_to(ROOT / folder).with_suffix("").parts])
            for node in parsed(path).body:
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and node.name[0] != "_":
                    found[node.name].add(module)
    return found


def texts_alone(tree):
    """Docstrings of modules, classes, functions and attributes: strings that are statements, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


def unknown_names(tree):
    """Names that are read and stand nowhere in their file, with their lines; an annotation is read only when asked."""
    known = {*dir(builtins), "__file__", "__path__", "__spec__"}
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()) | ast.alias(asname=str(name)) | ast.arg(arg=name):
                known.add(name)
            case ast.alias(name=name):
                known.add(name.split(".")[0])
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                known.add(node.name)
            case ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                known.add(name)
            case ast.MatchMapping(rest=str(name)):
                known.add(name)
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id not in known:
            yield node.lineno, node.id


@pytest.mark.parametrize("tree", TREES)
def test_names_are_known(tree):
    """Style and types cannot tell: they take the shapes in annotations for names."""
    unknown = [
        f"{path.relative_to(ROOT)}:{line} {name}"
        for path in python_files(tree)
        for line, name in unknown_names(parsed(path))
    ]
    assert not unknown, "\n".join(unknown)


def test_a_name_that_nobody_imported_is_unknown():
    source = "from os import path as p\ndef f(a: Missing, *b, **c) -> int:\n    return [d for d in b] + p(a, c)\n"
    assert list(unknown_names(ast.parse(source))) == [(2, "Missing")]


@pytest.mark.parametrize("tree", [*PACKAGES, "tests"])
def test_no_folder_holds_more_modules_than_one_can_overlook(tree):
    counts = defaultdict(int)
    for path in python_files(tree):
        counts[path.parent.relative_to(ROOT).as_posix()] += path.name != "__init__.py"
    assert not {folder: count for folder, count in counts.items() if count > MOST_MODULES}


@pytest.mark.parametrize("tree", PACKAGES)
def test_every_room_says_what_it_is(tree):
    rooms = {path.parent for path in python_files(tree)}
    silent = [room for room in rooms if not ast.get_docstring(parsed(room / "__init__.py"))]
    assert not silent


def test_a_public_name_stands_in_one_module_or_fulfils_a_contract():
    shared = {name: modules for name, modules in public_names().items() if len(modules) > 1}
    unexplained = {
        name: sorted(modules)
        for name, modules in sorted(shared.items())
        if not any(modules <= contract for contract in CONTRACTS.values())
    }
    assert not unexplained
    assert len(shared) <= MOST_SHARED_NAMES, sorted(shared)


def test_files_of_tests_have_names_of_their_own():
    """Folders of tests are no packages: of two files of one name, only the first can be imported."""
    found = defaultdict(list)
    for path in (ROOT / "tests").rglob("*.py"):
        found[path.name].append(path.relative_to(ROOT).as_posix())
    assert not {name: paths for name, paths in found.items() if len(paths) > 1 and name.startswith("test_")}


def test_contracts_name_modules_that_there_are():
    files = {folder: python_files(folder) for folder in PACKAGES}
    modules = {
        ".".join([PACKAGES[folder], *path.relative_to(ROOT / folder).with_suffix("").parts])
        for folder, paths in files.items()
        for path in paths
    }
    assert set().union(*CONTRACTS.values()) <= modules


@pytest.mark.parametrize("tree", TREES)
def test_docstrings_stand_alone(tree):
    leaning = [
        f"{path.relative_to(ROOT)}:{line} {text.strip().splitlines()[0]}"
        for path in python_files(tree)
        for line, text in texts_alone(parsed(path))
        if LEANING.match(text)
    ]
    assert not leaning, "\n".join(leaning)
