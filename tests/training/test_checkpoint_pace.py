"""How often a run is saved, by a clock that the tests turn."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny_training import new_trainer, tiny_config

from instdrive_core.training import run
from instdrive_core.training.checkpoint_pace import SHARE, CheckpointPace


class Clock:
    """Stands still unless moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def count_saves(clock: Clock, step_seconds: float, save_seconds: float, points: int) -> int:
    pace, saves = CheckpointPace(clock), 0
    for _ in range(points):
        clock.now += step_seconds
        if pace.is_due():
            with pace.time_saving():
                clock.now += save_seconds
            saves += 1
    return saves


def test_checkpoints_that_are_written_quickly_are_all_written() -> None:
    assert count_saves(Clock(), step_seconds=60, save_seconds=1, points=60) == 60


def test_slow_ones_take_no_more_than_their_share_of_the_time() -> None:
    clock = Clock()
    saves = count_saves(clock, step_seconds=15, save_seconds=5, points=600)
    assert 0.5 * SHARE < saves * 5 / (clock.now - 100) <= SHARE * 1.01
    assert saves < 120


@pytest.mark.parametrize(("save_seconds", "kept"), [(0.0, [20, 30, 20, 40, 60]), (1e6, [20, 30, 60])])
def test_the_end_of_a_stage_is_always_kept(
    save_seconds: float, kept: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, saved = Clock(), []

    def save(path: Path, trainer) -> None:
        clock.now += save_seconds
        saved.append(trainer.iteration)

    monkeypatch.setattr(run, "save_checkpoint", save)
    monkeypatch.setattr(run, "CheckpointPace", lambda: CheckpointPace(clock))
    trainer, _ = new_trainer(tiny_config())
    run.run_trainer(trainer, tmp_path, lambda event: None)
    assert saved == kept
