"""The light of a scene is told by what stands on its ground."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, PAVEMENT, ROAD, parked_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.scene_light import estimate_light
from instdrive_core.edits.holes.shade import MAX_DARKNESS, SceneLight, cast_shade, compute_opacities
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color


def shaded_street(sun, share):
    """The parked street with what a sun leaves dark beside both cars."""
    scene = deepcopy(parked_street().scene)
    means = scene.gaussians.means
    ground = np.isin(scene.instance_ids, (ROAD, PAVEMENT)) & (means[:, 2] < 0.3)
    steps = np.linspace(0, CAR_SIZE[2], 16)[:, None] * np.array(sun)
    dark = np.zeros(len(means), bool)
    for center in (CAR_CENTER, CAR_CENTER + np.array([0, 6.5, 0])):
        apart = np.abs(means[:, None, :2] - center[:2] - steps) < CAR_SIZE[:2] / 2
        dark |= apart.all(axis=2).any(axis=1)
    colors = color_from_dc(scene.gaussians.sh_dc)
    colors[dark & ground] *= 1 - share
    scene.gaussians.sh_dc[:] = dc_from_color(colors)
    return Document(scene)


@pytest.mark.parametrize("sun", [(-1.2, 0.0), (-0.9, 0.6)])
def test_the_sun_is_found_by_its_shadows(sun):
    light = estimate_light(shaded_street(sun, 0.5), 0.0)
    assert np.linalg.norm(np.subtract(light.sun, sun)) < 0.5
    assert light.sun_share == pytest.approx(0.5, abs=0.15)


def test_no_sun_is_found_where_nothing_is_dark():
    light = estimate_light(Document(parked_street().scene), 0.0)
    assert light.sun == (0.0, 0.0)
    assert light.sun_share == 0


def test_things_that_were_moved_tell_nothing():
    document = shaded_street((-1.2, 0.0), 0.5)
    document.apply(MoveInstances((CAR, OTHER_CAR), (-4.0, 0.0, 0.0)))
    assert estimate_light(document, 0.0) == SceneLight()


def test_a_shade_is_dark_below_and_as_soft_as_its_light():
    rng = np.random.default_rng(0)
    body = rng.uniform([-1, -2, 0.1], [1, 2, 1.4], (4000, 3))
    shade = cast_shade(body, SceneLight(0.6, softness=0.3))
    within = (np.abs(shade.places) < [0.6, 1.6]).all(axis=1)
    assert shade.darkness[within] == pytest.approx(0.6, abs=0.03)
    assert np.abs(shade.places).max(axis=0) == pytest.approx([1.3, 2.3], abs=0.6)
    thrown = cast_shade(body, SceneLight(0.6, (2.0, 0.0), 0.4, 0.3))
    assert thrown.places[:, 0].max() == pytest.approx(shade.places[:, 0].max() + 2 * 1.4, abs=0.6)


def test_overlapping_splats_are_as_dark_together_as_asked_for():
    rng = np.random.default_rng(0)
    body = rng.uniform([-3, -3, 0.1], [3, 3, 1.4], (20_000, 3))
    shade = cast_shade(body, SceneLight(0.7))
    weights = np.exp(-0.5 * ((shade.places) ** 2).sum(axis=1) / 0.3**2)
    left = np.prod(1 - compute_opacities(shade) * weights)
    assert left == pytest.approx(0.3, abs=0.05)
    assert (compute_opacities(shade) < 0.3).all(), "each is faint"
    assert MAX_DARKNESS < 0.9


@pytest.mark.parametrize("stretch", [[60, 1, 1], [1, 1, 0]])
def test_what_is_too_large_or_in_the_air_has_none(stretch):
    body = np.random.default_rng(0).uniform(0, 1, (1000, 3)) * stretch + [0, 0, 0.1 if stretch[2] else 5.0]
    assert not len(cast_shade(body, SceneLight()).places)
