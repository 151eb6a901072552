"""Shapes and types of the core's pure packages are checked by beartype while the tests run."""

from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

ROOT = Path(__file__).resolve().parents[1]
CHECKED = ("maths", "instances", "scene", "edits")


def _checked_modules() -> list[str]:
    """Modules of pure numpy; Numba cannot cache functions that a checker has wrapped."""
    files = [file for package in CHECKED for file in (ROOT / "instdrive_core" / package).glob("*.py")]
    pure = [file for file in files if file.stem != "__init__" and "import numba" not in file.read_text()]
    return [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in pure]


install_import_hook(_checked_modules(), "beartype.beartype")
# The first example of a test may have to compile what it tests: that takes seconds, and says nothing of it.
settings.register_profile("compiling", deadline=None)
settings.load_profile("compiling")


@pytest.fixture(scope="session", autouse=True)
def _own_state_folder(tmp_path_factory):
    """Tests, and the editors they start, never touch the user's recent files, logs and recovery journals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INSTDRIVE_STATE", str(tmp_path_factory.mktemp("state")))
        yield


SHARED = ROOT.parent / "shared"


@pytest.fixture(scope="session")
def pandaset_clip() -> Path:
    """The shared real clip; tests that need it are skipped, and say so, where it is absent."""
    path = SHARED / "data" / "pandaset" / "002"
    if not path.is_dir():
        pytest.skip(f"the shared PandaSet clip is not at {path}")
    return path
