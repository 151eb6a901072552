"""The two arguments that every example takes."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
SAMPLE = HERE.parent / "assets" / "sample_scene"


def scene_and_folder() -> tuple[Path, Path]:
    """The scene to edit and the folder to write into."""
    scene = Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLE
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "out"
    folder.mkdir(parents=True, exist_ok=True)
    return scene, folder
