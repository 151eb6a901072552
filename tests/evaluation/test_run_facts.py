"""A run folder that cannot be evaluated says what is wrong with it."""

import json
from pathlib import Path

import pytest

from instdrive_core.errors import DataError
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts

FACTS = {
    "clip": "drive",
    "cameras": "3",
    "scale": 0.5,
    "first_frame": None,
    "last_frame": 9,
    "masks": "exact",
    "seed": 4,
    "iterations": 100,
    "train_seconds": 1.5,
    "peak_rss_mb": 300,
    "backend": "cpu",
}


def test_reads_facts_and_the_part_of_the_clip(tmp_path: Path):
    (tmp_path / "run.json").write_text(json.dumps(FACTS))
    facts = read_run_facts(tmp_path)
    assert facts == FACTS
    options = build_clip_options(facts)
    assert (options.cameras, options.scale, options.first_frame, options.last_frame) == ("3", 0.5, None, 9)


def test_a_folder_without_a_finished_run(tmp_path: Path):
    with pytest.raises(DataError, match="no finished run"):
        read_run_facts(tmp_path)


@pytest.mark.parametrize(
    ("text", "problem"), [("{", "not valid JSON"), ("[]", "'clip' is missing"), ('{"clip": "a"}', "'cameras'")]
)
def test_damaged_facts(tmp_path: Path, text: str, problem: str):
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(DataError, match=problem):
        read_run_facts(tmp_path)
