"""Shapes and types of the core's pure packages are checked by beartype while the tests run."""

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook(
    ["instdrive_core.maths", "instdrive_core.instances", "instdrive_core.scene", "instdrive_core.edits"],
    "beartype.beartype",
)

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def pandaset_clip() -> Path:
    """The shared real clip; tests that need it are skipped, and say so, where it is absent."""
    path = SHARED / "data" / "pandaset" / "002"
    if not path.is_dir():
        pytest.skip(f"the shared PandaSet clip is not at {path}")
    return path
