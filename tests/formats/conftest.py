from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def splat_files() -> Path:
    """Splat files written by other programs; tests that need them are skipped, and say so, where they are absent."""
    path = Path(__file__).resolve().parents[3] / "shared" / "data" / "splats"
    if not path.is_dir():
        pytest.skip(f"the shared splat files are not at {path}")
    return path
