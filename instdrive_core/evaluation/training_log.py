"""Steps of training as a run's `log.jsonl` reports them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

LOG = "log.jsonl"


@dataclass(frozen=True)
class LoggedStep:
    """One reported step."""

    stage: str
    seconds: float
    loss: float
    psnr: float | None
    """PSNR of the step's training image, dB; None where the stage draws none."""
    gaussians: int
    terms: dict[str, float]
    """Weighted loss terms by name."""


def read_log(run: Path) -> list[LoggedStep]:
    """Read the steps that a run reported, in order; none where it kept no log. Lines that tell no step are passed over:
    a kill cuts the last one off, and a report can do without it."""
    path = run / LOG
    if not path.is_file():
        return []
    steps = (_parse_step(line) for line in path.read_text(encoding="utf-8", errors="replace").splitlines())
    return [step for step in steps if step is not None]


def get_column(steps: Sequence[LoggedStep], name: str) -> Float64[ndarray, " n"]:
    """A field of every step; NaN where it is None."""
    values = [getattr(step, name) for step in steps]
    return np.array([np.nan if value is None else value for value in values], np.float64)


def list_terms(steps: Sequence[LoggedStep]) -> list[str]:
    """Every loss term that occurs, in order of appearance."""
    return list(dict.fromkeys(name for step in steps for name in step.terms))


def get_term(steps: Sequence[LoggedStep], name: str) -> Float64[ndarray, " n"]:
    """A loss term of every step; NaN where the step has none."""
    return np.array([step.terms.get(name, np.nan) for step in steps], np.float64)


def _parse_step(line: str) -> LoggedStep | None:
    try:
        fields = json.loads(line)
        psnr = fields.get("psnr")
        terms = {str(name): float(value) for name, value in fields.get("terms", {}).items()}
        return LoggedStep(
            str(fields["stage"]),
            float(fields["seconds"]),
            float(fields["loss"]),
            None if psnr is None else float(psnr),
            int(fields["gaussians"]),
            terms,
        )
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
