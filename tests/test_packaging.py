"""Wheel and source archive hold what they should; the wheel, installed outside the checkout, runs."""

import subprocess
import sys
import tarfile
import tomllib

import pytest
from wheel_of_checkout import ARCHIVED, FILES, FOLDERS, PIP, RESOURCES, ROOT, build_wheel, copy_sources, run


def files_under(folder):
    paths = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(folder).as_posix() for path in paths}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of what is packaged, so that the checkout stays clean."""
    return copy_sources(tmp_path_factory.mktemp("source"))


@pytest.fixture(scope="module")
def installed(source, tmp_path_factory):
    """A folder with the wheel's content."""
    wheels, target = (tmp_path_factory.mktemp(name) for name in ("wheels", "installed"))
    wheel = build_wheel(source, wheels)
    run(*PIP, "install", "--no-deps", "--no-index", "--target", str(target), str(wheel), cwd=wheels)
    return target


def test_the_wheel_holds_every_module_and_resource(installed):
    for folder, package in FOLDERS.items():
        expected = {name for name in files_under(ROOT / folder) if not name.endswith((".nbi", ".nbc"))}
        missing = expected - files_under(installed / package)
        assert not missing, f"list packages and package-data of {sorted(missing)} in pyproject.toml"
    for folder, package in RESOURCES.items():
        assert files_under(ROOT / folder) <= files_under(installed / package)


def test_the_wheel_holds_nothing_else(installed):
    found = {path.split("/")[0] for path in files_under(installed)}
    assert {name for name in found if not name.endswith(".dist-info")} <= {*FOLDERS.values(), "bin"}
    packages = [installed / package for package in FOLDERS.values()]
    strays = {name for package in packages for name in files_under(package) if name.endswith((".nbi", ".nbc", ".log"))}
    assert not strays


def test_the_source_archive_builds_and_tests(source, tmp_path):
    code = f"from setuptools import build_meta; build_meta.build_sdist({str(tmp_path)!r})"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=source, capture_output=True, text=True, timeout=300, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "would be ignored" not in result.stderr
    (archive,) = tmp_path.glob("instdrive-*.tar.gz")
    with tarfile.open(archive) as packed:
        found = {name.partition("/")[2] for name in packed.getnames()}
    expected = {f"{folder}/{name}" for folder in (*FOLDERS, *RESOURCES) for name in files_under(source / folder)}
    expected |= {f"{folder}/{name}" for folder in ARCHIVED if folder != "docs" for name in files_under(source / folder)}
    expected |= {f"docs/{name}" for name in files_under(source / "docs") if name.endswith((".md", ".jsonl"))}
    assert expected | set(FILES) <= found
    assert not {name for name in found if "/__pycache__" in name or name.startswith(("runs", ".venv", ".git"))}


def test_the_installed_editor_finds_its_resources(installed, tmp_path):
    code = """
import instdrive_app, instdrive_core
from importlib.resources import files
print(instdrive_app.__file__, instdrive_core.__file__, sep="\\n")
for package in ("shaders", "assets"):
    for entry in files(f"instdrive_app.{package}").iterdir():
        print(package, entry.name)
print("void main" in (files("instdrive_app.shaders") / "splat.vert").read_text())
"""
    lines = run(sys.executable, "-c", code, cwd=tmp_path, PYTHONPATH=str(installed)).splitlines()
    assert all(line.startswith(str(installed)) for line in lines[:2]), "imported from elsewhere"
    assert lines[-1] == "True"
    for folder in RESOURCES:
        expected = {f"{folder} {path.name}" for path in (ROOT / folder).iterdir() if path.name != "__pycache__"}
        assert expected <= set(lines)


def test_the_installed_command_runs(installed, tmp_path):
    script = installed / "bin" / "instdrive"
    text = run(sys.executable, str(script), "--help", cwd=tmp_path, PYTHONPATH=str(installed))
    assert "usage: instdrive COMMAND" in text
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    text = run(sys.executable, str(script), "--version", cwd=tmp_path, PYTHONPATH=str(installed))
    assert text == f"instdrive {version}\n"
    text = run(sys.executable, str(script), "apply", "--help", cwd=tmp_path, PYTHONPATH=str(installed))
    assert "--recolor" in text
