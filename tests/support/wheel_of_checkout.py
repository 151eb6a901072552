"""The wheel of this checkout, built from a copy of its sources, so that the checkout stays clean."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"instdrive_core": "instdrive_core", "app": "instdrive_app"}
RESOURCES = {"shaders": "instdrive_app/shaders", "assets": "instdrive_app/assets"}
ARCHIVED = ("tests", "benchmarks", "docs", "examples")
"""Only in the source archive."""
FILES = (
    *("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "Makefile", "constraints.txt", "mkdocs.yml"),
    *("CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff"),
)
PIP = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")


def run(*command, cwd, **environment):
    """What a command prints; fails with all it printed unless it succeeds."""
    result = subprocess.run(
        command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def copy_sources(target):
    """Copy what is packaged into `target`; returns it."""
    for name in (*FOLDERS, *RESOURCES, *ARCHIVED):
        shutil.copytree(ROOT / name, target / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "*.jpg"))
    for name in FILES:
        shutil.copy(ROOT / name, target / name)
    return target


def build_wheel(sources, target):
    """Build the wheel of `sources` in the folder `target`; returns its path."""
    run(*PIP, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(target), str(sources), cwd=sources)
    (wheel,) = target.glob("instdrive-*.whl")
    return wheel
