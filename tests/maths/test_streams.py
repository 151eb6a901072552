"""Random streams: no two uses of one seed share numbers."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from instdrive_core.maths.streams import Stream, make_generator

CORE = Path(__file__).parents[2] / "instdrive_core"
BARE_SEEDS = {"datasets/synthetic/write.py", "edits/kinds/fill_hole.py", "edits/holes/ground_plane.py"}
"""Where a seed stands alone, so that streets and saved projects stay as they are; see `maths/streams.py`."""
WITHOUT_A_SEED = {"training/warm_up.py", "training/kernel_warm_up.py"}
"""Throw-away numbers that no result depends on."""


def _first_numbers(seed: int, stream: Stream, *numbers: int) -> tuple[int, ...]:
    return tuple(make_generator(seed, stream, *numbers).integers(0, 1 << 62, 4).tolist())


def test_no_two_streams_agree() -> None:
    drawn = [
        _first_numbers(seed, stream, *numbers)
        for seed in (0, 1, 7)
        for stream in Stream
        for numbers in ((), (0,), (1,), (0, 0), (0, 1), (1, 0))
    ]
    street = [np.random.default_rng(part) for seed in (0, 1, 7) for part in np.random.SeedSequence(seed).spawn(8)]
    sweeps = [np.random.default_rng([seed, step]) for seed in (0, 1, 7) for step in range(1, 9)]
    bare = [np.random.default_rng(seed) for seed in (0, 1, 7)]
    drawn += [tuple(rng.integers(0, 1 << 62, 4).tolist()) for rng in (*street, *sweeps, *bare)]
    assert len(set(drawn)) == len(drawn)


def test_same_arguments_give_same_numbers() -> None:
    assert _first_numbers(3, Stream.RGB_VIEWS, 5) == _first_numbers(3, Stream.RGB_VIEWS, 5)


@pytest.mark.parametrize(("seed", "number"), [(-1, 0), (0, -1), (0, 1 << 32)])
def test_numbers_outside_the_range_are_refused(seed: int, number: int) -> None:
    with pytest.raises(ValueError, match=r"-1|non-negative|32 bits"):
        make_generator(seed, Stream.RGB_VIEWS, number)


def test_each_stream_is_drawn_from() -> None:
    text = "\n".join(path.read_text() for path in CORE.rglob("*.py") if path.name != "streams.py")
    assert [stream.name for stream in Stream if f"Stream.{stream.name}" not in text] == []


def test_core_draws_from_streams_only() -> None:
    """A generator of a bare seed may share its numbers with another."""
    bare = set()
    for path in CORE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.random.default_rng", "default_rng"):
                bare.add(path.relative_to(CORE).as_posix())
    bare -= {"maths/streams.py", "datasets/synthetic/world/layout.py", *WITHOUT_A_SEED}
    assert bare == BARE_SEEDS
