"""The asked part of a log, ``--first`` and ``--last``: time steps, or seconds as in ``3s`` and ``8.5s``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import OptionError

_SLACK = 1e-6
"""Seconds by which a step may lie outside: its time was computed."""


def build_range_test(options: ClipOptions, step_times: Mapping[int, float]) -> Callable[[int], bool]:
    """Build the function that tells whether a time step lies in the asked part, both ends included.

    Args:
        options: what was asked for.
        step_times: seconds of each time step, counted from any moment; the earliest one is second 0.

    Raises OptionError where an end is no step and no number of seconds, or the last lies before the first.
    """
    start = min(step_times.values(), default=0.0)

    def find_end(option: str, asked: int | str | None, default: float) -> tuple[bool, float]:
        return (False, default) if asked is None else _parse_moment(option, asked)

    first_timed, first = find_end("--first", options.first_frame, -math.inf)
    last_timed, last = find_end("--last", options.last_frame, math.inf)
    if first_timed == last_timed and first > last:
        problem = f"--first {options.first_frame} lies after --last {options.last_frame}"
        raise OptionError(f"{problem}; give the earlier end first, e.g. --first 3s --last 8.5s")

    def is_asked(step: int) -> bool:
        seconds = step_times.get(step, math.nan) - start  # NaN lies in no range
        after = seconds >= first - _SLACK if first_timed else step >= first
        before = seconds <= last + _SLACK if last_timed else step <= last
        return after and before

    return is_asked


def describe_steps(step_times: Mapping[int, float]) -> str:
    """Say which steps and seconds there are, for messages on a part that holds none."""
    steps, times = sorted(step_times), sorted(step_times.values())
    return f"{steps[0]}–{steps[-1]}, or 0–{times[-1] - times[0]:g}s" if steps else "none"


def _parse_moment(option: str, asked: int | str) -> tuple[bool, float]:
    """Whether it is seconds, and its number."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*s\s*", asked) if isinstance(asked, str) else None
    if found:
        return True, float(found[1])
    if isinstance(asked, str):
        raise OptionError(f"{option} {asked!r} is no moment; give a time step, e.g. 30, or seconds, e.g. 8.5s")
    return False, asked
