"""Where a LiDAR looks is measured on its points."""

import numpy as np
import pytest

from instdrive_core.masks.image.beams import USUAL_END, measure_beams


def street(elevations, walls=((0, 120, 22.0), (120, 240, 30.0), (240, 360, 60.0)), top=np.inf):
    """What beams meet amid walls (azimuth from, to, metres away) up to a height in metres above the sensor."""
    points = []
    for first, last, distance in walls:
        azimuths = np.radians(np.arange(first, last, 0.2))
        for elevation in np.radians(elevations):
            rays = np.stack([np.cos(azimuths), np.sin(azimuths), np.full_like(azimuths, np.tan(elevation))], axis=1)
            points.append(distance * rays)
    points = np.concatenate(points).astype(np.float32)
    return points[points[:, 2] < top]


@pytest.mark.parametrize(
    ("elevations", "highest", "gap"),
    [(np.arange(-24.8, 2.1, 0.4), 2.0, 0.4), (np.arange(-30.67, 10.8, 1.33), 10.56, 1.33)],
    ids=["low and dense", "high and coarse"],
)
def test_the_highest_beam_and_the_gap_between_beams_are_measured(elevations, highest, gap):
    beams = measure_beams([street(elevations)])
    assert beams.highest == pytest.approx(highest, abs=0.1)
    np.testing.assert_allclose(beams.compute_gaps(np.array([[0.5, highest]])), gap, atol=0.05)
    assert beams.upper_end == pytest.approx(highest - gap / 2, abs=0.1)


def test_a_wall_of_one_height_does_not_end_the_field():
    low = street(np.arange(-20, 15, 0.3), walls=((0, 360, 25.0),), top=2.4)
    assert measure_beams([low]).highest == USUAL_END


def test_without_points_nothing_is_known():
    beams = measure_beams([])
    assert beams.highest == USUAL_END
    np.testing.assert_array_equal(beams.compute_gaps(np.ones((2, 2))), 0)
