"""Figures of a clip's run, read from what its job wrote, wherever the runs are."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from instdrive_core.evaluation.comparison import EVALUATED
from instdrive_core.fleet.clip_work import RECORDING, WORKER
from instdrive_core.fleet.place import FleetPlace
from instdrive_core.fleet.plan import ClipWishes, FleetClip
from instdrive_core.jobs.job_file import FOLDER, PICTURE, STATE
from instdrive_core.jobs.stages import REPORT
from instdrive_core.recording.folder import MANIFEST
from instdrive_core.training.run import FACTS


@dataclass(frozen=True)
class ClipFigures:
    """What there is to say about a run; None where it is not known yet."""

    stage: str | None = None
    """Title of the stage that runs or was interrupted."""
    share: float | None = None
    """Share of it that is done."""
    psnr: float | None = None
    """PSNR of held-out photos, dB."""
    things: int | None = None
    """Instances of the scene."""
    clicks: float | None = None
    """Share of clicks that select their object."""
    splats: int | None = None
    minutes: float = 0.0
    """Time spent on all stages so far, interruptions left out."""
    report: str | None = None
    """Path of the evaluation's page."""
    host: str | None = None
    """Machine that worked on it last."""
    notes: tuple[str, ...] = ()


def read_clip_figures(place: FleetPlace, clip: FleetClip) -> ClipFigures:
    """Read a run's figures; what is missing or half there counts as not known."""
    state = _read(place, f"{clip.name}/{FOLDER}/{STATE}")
    facts, measured = _read(place, f"{clip.name}/{FACTS}"), _read(place, f"{clip.name}/{EVALUATED}")
    stages = [stage for stage in state.get("stages", []) if isinstance(stage, dict)]
    running = next((stage for stage in stages if stage.get("status") == "running"), {})
    return ClipFigures(
        stage=running.get("title"),
        share=_number(running.get("share")),
        psnr=_number(measured.get("psnr")),
        things=_count(facts.get("n_instances")),
        clicks=_number((measured.get("click") or {}).get("hit_rate")),
        splats=_count(facts.get("n_gaussians")),
        minutes=sum(_number(stage.get("seconds")) or 0.0 for stage in stages) / 60,
        report=f"{clip.name}/{REPORT}" if measured else None,
        host=_read(place, f"{clip.name}/{FOLDER}/{WORKER}").get("host"),
        notes=tuple(map(str, state.get("notes", []))),
    )


def read_clip_picture(place: FleetPlace, clip: FleetClip) -> bytes | None:
    """Read the JPEG of a run's last drawn training photo; None before there is one."""
    return place.read(f"{clip.name}/{FOLDER}/{PICTURE}")


def read_worker_token(place: FleetPlace, clip: FleetClip) -> str | None:
    """Read which attempt a worker began last; None where none did."""
    return _read(place, f"{clip.name}/{FOLDER}/{WORKER}").get("token")


def is_clip_finished(place: FleetPlace, clip: FleetClip, wishes: ClipWishes) -> bool:
    """Whether nothing is left to do for a clip."""
    if _read(place, f"{clip.name}/{FOLDER}/{STATE}").get("status") != "done":
        return False
    return not wishes.record or place.read(f"{clip.name}/{RECORDING}/{MANIFEST}") is not None


def _read(place: FleetPlace, name: str) -> dict[str, Any]:
    try:
        content = json.loads(place.read(name) or b"{}")
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _count(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None
