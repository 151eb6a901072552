"""Facts that a training run keeps of itself in `run.json` beside its scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import DataError

FACTS = "run.json"
_REQUIRED = (
    "clip",
    "cameras",
    "scale",
    "first_frame",
    "last_frame",
    "masks",
    "seed",
    "iterations",
    "train_seconds",
    "peak_rss_mb",
    "backend",
)


def read_run_facts(run: Path) -> dict[str, Any]:
    """The facts of a finished run.

    Raises DataError where the folder holds no finished run or the file is damaged.
    """
    path = run / FACTS
    if not path.is_file():
        raise DataError(run, f"there is no {FACTS}, so this is no finished run", "Give the folder that `train` wrote.")
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(path, f"is not valid JSON ({error})", "Train the run again.") from error
    missing = [name for name in _REQUIRED if not isinstance(facts, dict) or name not in facts]
    if missing:
        raise DataError(path, f"field {missing[0]!r} is missing", "Train the run again with this version.")
    return facts


def build_clip_options(facts: dict[str, Any]) -> ClipOptions:
    """Build the options that load the part of the clip on which the run was trained."""
    return ClipOptions(
        cameras=facts["cameras"],
        scale=facts["scale"],
        first_frame=facts["first_frame"],
        last_frame=facts["last_frame"],
        fisheye_field=facts.get("fisheye_field", ClipOptions.fisheye_field),
    )
