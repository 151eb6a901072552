"""Sky is where beams met nothing, or where it looks like the sky."""

import numpy as np
import pytest
from painted_street import COLORS, HEIGHT, SKY, WALL, WIDTH, camera, photo, truth

from instdrive_core.masks.image.beams import BeamField
from instdrive_core.masks.image.sky import SkyColors, find_certain_sky, find_sky_gaps, find_sky_seeds

BEAMS = BeamField(15.0, np.array([1.0, 13.0]), np.array([1.0, 4.0]))


def plain(color):
    return np.full((HEIGHT, WIDTH, 3), color, np.uint8)


def test_nothing_is_sky_within_a_beam_of_a_surface_or_below_the_horizon():
    supported = truth(0) != SKY
    found = find_certain_sky(supported, photo(0), camera(), BEAMS)
    top_of_wall = int(np.flatnonzero(supported[:, 80])[0])
    assert found[0].all()
    assert not found[top_of_wall - 5 :].any()
    assert not find_certain_sky(np.zeros_like(supported), photo(0), camera(), BEAMS)[46:].any(), (
        "no beam looks down for the sky"
    )


def test_a_dark_window_within_a_wall_is_no_sky():
    supported = np.ones((HEIGHT, WIDTH), bool)
    supported[5:40, 40:120] = False
    assert not find_certain_sky(supported, plain(COLORS[SKY]), camera(), BEAMS).any()


def test_above_a_wall_that_leaves_the_field_of_view_nothing_is_known():
    supported = np.ones((HEIGHT, WIDTH), bool)
    supported[:13] = False
    assert not find_certain_sky(supported, plain(COLORS[SKY]), camera(), BEAMS).any()


def test_textured_regions_are_no_sure_sky():
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    assert not find_certain_sky(np.zeros((HEIGHT, WIDTH), bool), noise, camera(), BEAMS).any()


def test_sky_between_tall_walls_is_known_by_its_colour_elsewhere():
    supported = np.zeros((HEIGHT, WIDTH), bool)
    supported[13:] = True  # up to 15 degrees
    image = plain(COLORS[WALL])
    image[:13, 60:100] = COLORS[SKY]
    elsewhere = SkyColors()
    assert not find_sky_seeds(supported, image, camera(), BEAMS, elsewhere).any()
    elsewhere.add(photo(0), truth(0) == SKY, truth(0) != SKY)
    expected = np.zeros_like(supported)
    expected[:13, 60:100] = True
    np.testing.assert_array_equal(find_sky_seeds(supported, image, camera(), BEAMS, elsewhere), expected)


def test_likelihood_compares_sky_and_surface_whatever_their_sizes():
    colors = SkyColors()
    image = plain(COLORS[WALL])
    image[0] = COLORS[SKY]
    sky = np.zeros((HEIGHT, WIDTH), bool)
    sky[0] = True
    colors.add(image, sky, ~sky)
    found = colors.likelihood(image)
    assert found[0].min() > 0.99
    assert found[1:].max() < 0.01
    assert colors.likelihood(plain((0, 255, 0))).max() == pytest.approx(0), "never met"


def test_above_a_low_field_of_view_a_column_is_open_where_it_looks_like_sky():
    supported = np.zeros((HEIGHT, WIDTH), bool)
    low = BeamField(2.5, np.array([1.0]), np.array([0.4]))
    image = plain(COLORS[WALL])
    image[:, 80:] = COLORS[SKY]
    elsewhere = SkyColors()
    elsewhere.add(photo(0), truth(0) == SKY, truth(0) != SKY)
    open_anywhere = find_certain_sky(supported, image, camera(), low)
    assert open_anywhere[0, 1:70].all(), "beams alone do not tell what is above them"
    found = find_certain_sky(supported, image, camera(), low, elsewhere)
    assert not found[0, :79].any()
    assert found[0, 82:].all()


def test_unknown_parts_within_the_sky_are_sky_and_those_at_a_roof_are_not():
    sky = np.zeros((HEIGHT, WIDTH), bool)
    sky[:20] = True
    unknown = np.zeros_like(sky)
    unknown[:8, 30:50] = True
    unknown[12:20, 100:110] = True
    found = find_sky_gaps(unknown, sky & ~unknown, camera())
    assert found[:8, 30:50].all()
    assert not found[:, 100:110].any()
