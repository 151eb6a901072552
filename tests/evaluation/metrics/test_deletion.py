"""Deleting what a click selected: nothing else changes, nothing remains; mistakes show up in the right figure."""

import numpy as np
import pytest
from evaluation_scene import DRIVING, PARKED, POLE, ROAD, ToyDrive

from instdrive_core.evaluation.metrics import deletion
from instdrive_core.evaluation.metrics.clicks import Clicks
from instdrive_core.evaluation.metrics.deletion import score_deletions
from instdrive_core.evaluation.metrics.held_out import HeldOutView, measure_held_out_view


def quiet(stage: str, done: int, total: int) -> None:
    """No progress is shown."""


def held_out(drive: ToyDrive) -> list[HeldOutView]:
    return [measure_held_out_view(drive.scene, drive.clip, frame, drive.truth) for frame in drive.clip.held_out_frames]


def boxes(drive: ToyDrive) -> dict:
    tracks = {track.id: track for track in drive.clip.tracks}
    return {PARKED: tracks["parked"], DRIVING: tracks["driving"]}


def scores(drive: ToyDrive, clicks: list[Clicks]) -> dict:
    return score_deletions(drive.scene, held_out(drive), clicks, boxes(drive), 0, quiet)


def test_exact_selection_leaves_nothing_and_harms_nothing(drive):
    found = scores(drive, [Clicks(0, PARKED, PARKED, 5, 1.0), Clicks(0, DRIVING, DRIVING, 5, 1.0)])
    assert found["residue"] < 0.01
    assert found["collateral"] < 0.05, "blurred borders only"


def test_floaters_inside_the_box_are_residue(drive):
    rows = np.flatnonzero(drive.scene.instance_ids == PARKED)
    drive.scene.instance_ids[rows[::2]] = 77
    split = scores(drive, [Clicks(0, PARKED, PARKED, 1, 0.6)])
    assert 0.3 < split["residue"] < 1.2
    assert 0.2 < split["residue_kept"] < min(0.8, split["residue"]), "what comes to light is not counted"


def test_what_stays_is_measured_before_the_deletion(drive):
    nothing_stays = scores(drive, [Clicks(0, PARKED, PARKED, 1, 1.0)])
    everything_stays = scores(drive, [Clicks(0, PARKED, POLE, 1, 1.0)])
    assert nothing_stays["residue_kept"] < 0.01
    assert everything_stays["residue_kept"] == pytest.approx(1, abs=1e-5)


def test_what_is_deleted_besides_the_object_is_collateral(drive):
    ids = drive.scene.instance_ids
    exact = scores(drive, [Clicks(0, PARKED, PARKED, 1, 1.0)])
    ids[ids == ROAD] = PARKED
    merged = scores(drive, [Clicks(0, PARKED, PARKED, 1, 0.6)])
    assert merged["collateral"] > exact["collateral"] + 0.3
    assert merged["residue"] < 0.01


def test_actors_are_deleted_where_they_are(drive):
    # The driving box has moved 3 m between the two held-out steps; its box is taken at each view's time.
    for view in range(4):
        assert scores(drive, [Clicks(view, DRIVING, DRIVING, 1, 1.0)])["residue"] < 0.01


def test_objects_without_a_box_have_collateral_only(drive):
    found = scores(drive, [Clicks(0, POLE, POLE, 10, 1.0)])
    assert found["residue"] is None
    assert found["collateral"] < 0.02


def test_hits_weigh_by_clicks_and_misses_delete_nothing(drive):
    parked, driving = Clicks(0, PARKED, PARKED, 9, 1.0), Clicks(0, DRIVING, DRIVING, 1, 0.6)
    misses = [Clicks(0, PARKED, 0, 5, 0.0), Clicks(0, PARKED, ROAD, 5, 0.1)]
    alone = [scores(drive, [each])["collateral"] for each in (parked, driving)]
    assert scores(drive, [parked, *misses, driving])["collateral"] == pytest.approx(0.9 * alone[0] + 0.1 * alone[1])
    assert scores(drive, misses) == dict.fromkeys(("collateral", "residue", "residue_kept"))


def test_many_selections_are_sampled(drive, monkeypatch):
    clicks = [Clicks(view, label, label, 1, 1.0) for view in range(4) for label in (ROAD, PARKED, DRIVING)]
    drawn = []
    real = deletion.redraw_without_rows
    monkeypatch.setattr(deletion, "redraw_without_rows", lambda *args: drawn.append(1) or real(*args))
    monkeypatch.setattr(deletion, "MAX_DELETIONS", 5)
    sampled = score_deletions(drive.scene, held_out(drive), clicks, boxes(drive), 0, quiet)
    assert len(drawn) == 5
    again = score_deletions(drive.scene, held_out(drive), clicks, boxes(drive), 0, quiet)
    assert sampled == again
