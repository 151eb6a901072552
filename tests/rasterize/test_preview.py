"""The editor's frame: the same picture as `render`, and the splat that each pixel stands for."""

from __future__ import annotations

import numpy as np
import pytest
from little_scenes import Splats, plain_splats, random_splats, small_camera
from pixel_walks import find_pixel_contributors

from instdrive_core.rasterize.pixel_contributors import pick_winner
from instdrive_core.rasterize.preview import PickRule, render_preview
from instdrive_core.rasterize.reference import compute_fragment_weights, evaluate_fragments, find_blended_fragments
from instdrive_core.rasterize.render import render


def test_the_frame_is_what_render_shows() -> None:
    camera = small_camera(90, 70)
    splats = random_splats(camera, 500, 3, seed=1)
    frame, raster = render_preview(*splats.arrays(), camera), render(*splats.arrays(), camera)
    np.testing.assert_allclose(frame.color, raster.image, atol=1e-6)
    np.testing.assert_allclose(frame.alpha, raster.alpha, atol=1e-6)
    covered = raster.alpha > 1e-3
    np.testing.assert_allclose(frame.depth[covered], (raster.depth / raster.alpha)[covered], rtol=1e-4)
    assert not frame.depth[raster.alpha == 0].any()


def test_large_and_tiny_splats_beside_each_other() -> None:
    """More pairs of tile and splat than there is room for at first; splats within one tile; some of them outside."""
    camera = small_camera(640, 400)
    large = plain_splats(camera, [[320, 200]] * 300, list(np.linspace(3, 6, 300)), 250, 0.02)
    splats = large.joined(random_splats(camera, 4000, 3, seed=7))
    splats.log_scales[300:] -= np.float32(2.5)
    frame, raster = render_preview(*splats.arrays(), camera), render(*splats.arrays(), camera)
    np.testing.assert_allclose(frame.color, raster.image, rtol=3e-6, atol=2e-5)  # sums of hundreds in float32
    np.testing.assert_allclose(frame.alpha, raster.alpha, atol=2e-5)


def expected_winner(alphas: np.ndarray, weight: np.ndarray, opacities: np.ndarray, rule: PickRule) -> int:
    """The rule, said once more in plain words: place in the depth order, or -1."""
    total = weight.sum()
    solid = [v for v in np.flatnonzero(weight) if opacities[v] >= rule.min_opacity and alphas[v] >= rule.min_alpha]
    if solid and weight[solid[0]] >= rule.min_share * total:
        return int(solid[0])
    if not solid and total < rule.min_coverage:
        return -1
    gathered = 0.0
    for v in np.flatnonzero(weight):
        gathered += weight[v]
        if gathered >= total / 2 - 1e-9:
            return int(v)
    raise AssertionError("half of the weight is reached before the end")


@pytest.mark.parametrize("rule", [PickRule(), PickRule(0.6, 0.1, 0.8, 0.3)])
def test_winners_follow_the_rule_at_every_pixel(rule: PickRule) -> None:
    camera = small_camera()
    splats = random_splats(camera, 120, 3, seed=2)
    found = evaluate_fragments(*splats.arrays()[:4], camera)
    weight = compute_fragment_weights(found, find_blended_fragments(found))
    winner = render_preview(*splats.arrays(), camera, rule=rule).winner
    places = np.array(
        [
            [
                expected_winner(found.raw_alphas[:, y, x], weight[:, y, x], splats.opacities[found.rows], rule)
                for x in range(53)
            ]
            for y in range(37)
        ]
    )
    expected = np.where(places >= 0, found.rows[places], -1)
    assert (winner == expected).mean() > 0.999
    assert len(np.unique(winner)) > 20


def test_one_pixel_alone_agrees_with_the_frame() -> None:
    camera = small_camera(120, 80)
    splats = random_splats(camera, 900, 3, seed=3)
    frame = render_preview(*splats.arrays(), camera)
    rng = np.random.default_rng(0)
    pixels = np.stack([rng.integers(0, 120, 400), rng.integers(0, 80, 400)], axis=1)
    agreeing = 0
    for x, y in pixels:
        contributors = find_pixel_contributors(*splats.arrays()[:4], camera, int(x), int(y))
        assert contributors.weights.sum() == pytest.approx(frame.alpha[y, x], abs=1e-5)
        assert (np.diff(contributors.depths) >= 0).all()
        blended = (contributors.weights[:, None] * splats.channels[contributors.rows]).sum(axis=0)
        np.testing.assert_allclose(blended, frame.color[y, x], atol=1e-5)
        agreeing += pick_winner(contributors) == frame.winner[y, x]
    assert agreeing >= 399


def car_and(floater: Splats, camera) -> Splats:
    """Floaters first, then a car: three opaque splats, one behind the other."""
    car = plain_splats(camera, [[26, 18]] * 3, [6.0, 6.2, 6.4], 12, 0.8)
    return floater.joined(car)


def test_a_floater_before_a_car_does_not_win() -> None:
    camera = small_camera()
    floater = plain_splats(camera, [[26, 18]], [2.0], 4, 0.35)
    splats = car_and(floater, camera)
    frame = render_preview(*splats.arrays(), camera)
    contributors = find_pixel_contributors(*splats.arrays()[:4], camera, 26, 18)
    assert contributors.rows[0] == 0
    assert contributors.alphas[0] > 0.3
    assert frame.winner[18, 26] == pick_winner(contributors) == 1
    nearest_wins = PickRule(min_share=0.0)
    assert render_preview(*splats.arrays(), camera, rule=nearest_wins).winner[18, 26] == 0
    assert pick_winner(contributors, nearest_wins) == 0


def test_a_solid_splat_before_a_car_wins() -> None:
    camera = small_camera()
    splats = car_and(plain_splats(camera, [[26, 18]], [2.0], 4, 0.7), camera)
    assert render_preview(*splats.arrays(), camera).winner[18, 26] == 0


def test_faint_splats_stand_for_a_pixel_only_where_they_cover_half_of_it() -> None:
    camera = small_camera()
    haze = plain_splats(camera, [[26, 18]] * 8, list(np.linspace(3, 5, 8)), 30, 0.15)
    frame = render_preview(*haze.arrays(), camera)
    middle = int(np.argmax(np.cumsum(0.85 ** np.arange(8)) >= 0.5 * np.sum(0.85 ** np.arange(8))))
    assert frame.alpha[18, 26] > 0.5
    assert frame.winner[18, 26] == middle
    thin = plain_splats(camera, [[26, 18]], [3.0], 30, 0.25)
    frame = render_preview(*thin.arrays(), camera)
    assert frame.alpha[18, 26] > 0.2
    assert (frame.winner == -1).all()


def test_nothing_to_show() -> None:
    camera = small_camera()
    none = random_splats(camera, 0, 3, seed=0)
    frame = render_preview(*none.arrays(), camera)
    assert (frame.winner == -1).all()
    assert not frame.color.any()
    contributors = find_pixel_contributors(*none.arrays()[:4], camera, 3, 4)
    assert pick_winner(contributors) == -1
    with pytest.raises(ValueError, match="outside"):
        find_pixel_contributors(*none.arrays()[:4], camera, 53, 4)
