"""Ground in the sun and in the shade are told apart, kind by kind."""

import numpy as np
import pytest

from instdrive_core.edits.holes.sunlight.two_lights import fit_two_lights, measure_dimming


def paint(levels, dimmed, seed=0):
    """Grey ground: which is raised, which is dark, and colours."""
    rng = np.random.default_rng(seed)
    raised, dark = rng.random(2000) < 0.3, rng.random(2000) < 0.4
    grey = np.where(raised, levels[1], levels[0]) * np.where(dark, dimmed, 1) * np.exp(rng.normal(0, 0.06, 2000))
    return raised, dark, np.repeat(grey[:, None], 3, axis=1)


def test_a_pavement_in_the_shade_is_told_from_a_road_in_the_sun_that_is_as_bright():
    raised, dark, color = paint((0.35, 0.7), 0.5)
    lights = fit_two_lights(color, raised)
    assert lights is not None
    assert np.exp(lights.levels) == pytest.approx([0.35, 0.7], rel=0.05)
    assert np.exp(-lights.ratio) == pytest.approx(0.5, rel=0.06)
    assert ((lights.tell_shade(color, raised) > 0) == dark).mean() > 0.99


def test_dimming_is_measured_by_kind():
    raised, dark, color = paint((0.4, 0.7), 0.45)
    color[raised & dark] *= [1.0, 1.1, 1.2]
    lights = fit_two_lights(color, raised)
    assert lights is not None
    dimming = measure_dimming(color, raised, lights.tell_shade(color, raised), lights)
    assert dimming[0] == pytest.approx([0.45] * 3, rel=0.05)
    assert dimming[1] == pytest.approx([0.45, 0.495, 0.54], rel=0.05)


def test_a_kind_of_which_too_little_is_known_tells_nothing():
    _, _, color = paint((0.4, 0.4), 0.5)
    raised = np.zeros(len(color), bool)
    raised[:5] = True
    lights = fit_two_lights(color, raised)
    assert lights is not None
    assert np.isnan(lights.levels[1])
    assert not lights.tell_shade(color, raised)[:5].any()


def test_too_little_ground_has_no_lights():
    assert fit_two_lights(np.full((10, 3), 0.5), np.zeros(10, bool)) is None
