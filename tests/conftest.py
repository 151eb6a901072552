"""What holds for all tests: beartype checks the types and shapes of every call outside Numba's kernels, neither speed
nor chance decides what fails, and workers that run beside each other keep out of each other's way."""

import gc
import os
import re
import sys
import time
from pathlib import Path

import pytest
from checked_imports import CheckedFinder
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"instdrive_core": "instdrive_core", "app": "instdrive_app"}
"""Folder and import name of what is checked."""
KERNELS = re.compile(r"^\s*(import|from) (numba|llvmlite)\b", re.MULTILINE)
MANY_CALLS = "datasets/synthetic/world/"
"""Builds a street from ten thousand small meshes: checking each call takes longer than building it."""


def _checked_modules() -> list[str]:
    """Modules without kernels: Numba cannot cache functions that a checker has wrapped."""
    return [
        ".".join([package, *path.relative_to(ROOT / folder).with_suffix("").parts])
        for folder, package in PACKAGES.items()
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path.stem != "__init__"
        and MANY_CALLS not in path.as_posix()
        and not KERNELS.search(path.read_text(encoding="utf-8"))
    ]


sys.meta_path.insert(0, CheckedFinder(_checked_modules()))
# Where Python is told to keep no compiled modules, each of the many processes that tests start compiles all of the
# product: half a second for an editor.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Windows are drawn by Mesa's CPU renderer here. By itself it starts a thread for each core, which wait for each other
# where a neighbour's test has the cores: a fifth of the time of a frame.
os.environ.setdefault("LP_NUM_THREADS", "0")
# Threads of parallel kernels and of torch wait in a busy loop for each other and for more to do, unless told otherwise:
# a fifth of the time of training where a neighbour's test has the cores. Read as OpenMP is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# The first example of a test may have to compile what it tests: that takes seconds, and says nothing of it.
UNHURRIED = settings(
    deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture], print_blob=True
)
settings.register_profile("same every time", UNHURRIED, derandomize=True)
settings.register_profile("search", UNHURRIED, derandomize=False)  # pytest --hypothesis-profile=search
settings.load_profile("same every time")


FIRST = ("test_plain_install.py", "app/window", "training", "baselines", "benchmarks", "app", "jobs", "tracks", "masks")
FIRST += ("datasets", "test_examples.py")
"""Files, and rooms with files, of more than ten seconds. The very first needs no kernel of those that the first window
compiles beside it."""


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is collected stays to the end: no search for garbage looks at it, neither now nor later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="run the tests that are marked slow, too")


def pytest_collection_modifyitems(config, items):
    """Short files come last, so that all workers end together. Tests of a file stay together.

    Slow tests are left out, and counted as deselected, unless `--slow` or their own names ask for them.
    """

    def rank(item):
        path = item.path.relative_to(ROOT / "tests")
        return next((place for place, name in enumerate(FIRST) if path.is_relative_to(name)), len(FIRST))

    items.sort(key=rank)
    if config.getoption("--slow") or any("::" in name for name in config.args):
        return
    config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("slow")])
    items[:] = [item for item in items if not item.get_closest_marker("slow")]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """What a test has logged and printed goes from worker to master as text: half characters in it end the worker."""
    report = yield
    report.sections = [(title, text.encode("utf-8", "backslashreplace").decode()) for title, text in report.sections]
    return report


@pytest.fixture(scope="session", autouse=True)
def _own_state_folder(tmp_path_factory):
    """Tests, and the editors they start, never touch the user's recent files, logs and recovery journals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INSTDRIVE_STATE", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session", autouse=True)
def _compiled_code_is_saved_by_one_worker_at_a_time(tmp_path_factory):
    """Two processes that save two signatures of one kernel in one moment may give both files the same name."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    from numba.core.caching import IndexDataCacheFile

    from instdrive_core.files.file_lock import FileLock

    path, save = tmp_path_factory.getbasetemp().parent / "numba.lock", IndexDataCacheFile.save

    def save_alone(self, key, data):
        while (lock := FileLock.acquire(path)) is None:
            time.sleep(0.002)
        try:
            save(self, key, data)
        finally:
            lock.release()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(IndexDataCacheFile, "save", save_alone)
        yield


SHARED = ROOT.parent / "shared"


@pytest.fixture(scope="session")
def pandaset_clip() -> Path:
    """The shared real clip; tests that need it are skipped, and say so, where it is absent."""
    path = SHARED / "data" / "pandaset" / "002"
    if not path.is_dir():
        pytest.skip(f"the shared PandaSet clip is not at {path}")
    return path
