"""What a recording holds, in a few lines for a person."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json
from instdrive_core.recording.folder import name_file
from instdrive_core.scene.camera import CameraView
from instdrive_core.wording import format_count

REPORT = "report.md"
_LOWEST = 5
"""Views named for their low confidence."""


def summarize_recording(folder: Path, views: Sequence[CameraView]) -> dict[str, Any]:
    """Summarize the views' listings: instances seen, and confidence by camera where it was recorded."""
    listed = [read_json(folder / name_file("views", view, ".json")) for view in views]
    seen = {entry["id"] for listing in listed for entry in listing["objects"] if entry["pixels_visible"]}
    known = [listing for listing in listed if "confidence" in listing]
    if not known:
        return {"instances_seen": len(seen), "confidence": None}
    means = {f"{one['camera']}/{one['step']:02d}": one["confidence"]["mean"] for one in known}
    cameras = list(dict.fromkeys(one["camera"] for one in known))
    by_camera = {
        name: round(float(np.mean([one["confidence"]["mean"] for one in known if one["camera"] == name])), 4)
        for name in cameras
    }
    lowest = sorted(means, key=lambda key: (means[key], key))[:_LOWEST]
    mean = round(float(np.mean(list(means.values()))), 4)
    return {
        "instances_seen": len(seen),
        "confidence": {"mean": mean, "by_camera": by_camera, "lowest": {key: means[key] for key in lowest}},
    }


def write_recording_report(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the report of a recording, atomically. Raises DataError where it cannot be written."""
    lines = ["# Recording", ""]
    views, moments = format_count(len(manifest["views"]), "view"), format_count(len(manifest["moments"]), "moment")
    lines += [f"{views} of {format_count(len(manifest['cameras']), 'camera')}, {moments}.", ""]
    boxed = sum(entry["has_box"] for entry in manifest["instances"])
    lines += [f"{manifest['instances_seen']} of {len(manifest['instances'])} instances are seen; {boxed} have a box."]
    found = manifest["confidence"]
    if found is not None:
        lines += ["", "## Confidence", "", describe_confidence(found), "", "| camera | confidence |", "|---|---|"]
        lines += [f"| {name} | {share:.0%} |" for name, share in found["by_camera"].items()]
        lines += ["", "Lowest views: " + ", ".join(f"{key} {share:.0%}" for key, share in found["lowest"].items())]
    write_bytes(folder / REPORT, ("\n".join(lines) + "\n").encode())


def describe_confidence(found: dict[str, Any]) -> str:
    """Say in a sentence how far the recording can be trusted."""
    return f"At least two photos saw {found['mean']:.0%} of what the views show."
