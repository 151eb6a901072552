"""Boxes of things: how large they are, and what does not belong to them."""

import numpy as np
import pytest

from instdrive_core.tracks.boxes import fit_box

VIEWS = np.array([[8.0, 6.0], [9.0, 6.0]])


def body(length, width, top, bottom=0.3):
    """Points all over a body that stands on the ground."""
    rng = np.random.default_rng(0)
    return rng.uniform([-length / 2, -width / 2, bottom], [length / 2, width / 2, top], (800, 3))


def test_an_awning_above_a_walker_is_no_part_of_them():
    awning = body(1.4, 1.0, 2.36, 2.3)[:150]
    box = fit_box(np.concatenate([body(0.5, 0.5, 1.8), awning]), VIEWS)
    assert box.label == "Pedestrian"
    assert box.height < 1.85
    assert max(box.length, box.width) < 0.7


def test_a_few_points_between_a_walker_and_the_awning_change_nothing():
    awning, twigs = body(1.4, 1.0, 2.5, 2.2)[:200], np.column_stack([np.zeros((5, 2)), np.linspace(1.82, 2.18, 5)])
    box = fit_box(np.concatenate([body(0.5, 0.5, 1.8), awning, twigs]), VIEWS)
    assert box.label == "Pedestrian"
    assert max(box.length, box.width) < 0.7


def test_air_between_the_body_and_the_roof_of_a_van_does_not_cut_it():
    roof = body(4.8, 1.9, 2.6, 2.5)[:200]
    box = fit_box(np.concatenate([body(4.8, 1.9, 2.0), roof]), VIEWS)
    assert box.height > 2.5
    assert box.length >= 6.0


def test_a_car_that_comes_behind_another_has_a_hood_before_its_windscreen():
    ahead, behind = np.array([[20.0, 0.5], [21.0, 0.5]]), np.array([[-20.0, 0.5], [-21.0, 0.5]])
    windscreen, whole = body(1.0, 1.6, 1.5, 1.05), body(1.0, 1.6, 1.5)
    assert fit_box(windscreen, ahead).center[0] - fit_box(whole, ahead).center[0] == pytest.approx(1.1)
    assert fit_box(windscreen, behind).center[0] == pytest.approx(fit_box(whole, behind).center[0])
    long = body(4.4, 1.6, 1.5, 1.05)
    assert fit_box(long, ahead).length == pytest.approx(4.6), "no longer than cars are"


def test_the_higher_a_car_the_longer_it_is_taken_to_be():
    def guess(height):
        box = fit_box(body(1.0, 1.6, height), VIEWS)
        return box.length, box.width

    assert guess(1.5) == pytest.approx((4.6, 1.88))
    assert 4.6 < guess(1.9)[0] < guess(2.2)[0] < 6.0
    assert guess(2.6) == pytest.approx((6.0, 2.4))
