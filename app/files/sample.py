"""The small trained scene that comes with the program."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from instdrive_core.errors import InstDriveError

SAMPLE = "sample_scene"


class NoSceneError(InstDriveError):
    """There is no scene to open."""


def has_sample_scene() -> bool:
    """Whether this installation includes the sample scene."""
    return _find_path().exists()


def find_sample_scene() -> Path:
    """Find the sample scene. Raises NoSceneError where the installation lacks it."""
    path = _find_path()
    if not path.exists():
        raise NoSceneError(
            f"this installation has no sample scene ({path} is missing); "
            "name a scene: instdrive edit SCENE (a scene file or a run folder)"
        )
    return path


def _find_path() -> Path:
    return Path(str(resources.files("instdrive_app.assets").joinpath(SAMPLE)))
