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


def expected_winner(alphas: np.ndarray, weight: np.ndarray, opacities: np.ndarray, names: np.ndarray, rule: PickRule):
    """The rule, said once more in plain words: places in the depth order that may win, or -1."""
    solid = (weight > 0) & (opacities >= rule.min_opacity) & (alphas >= rule.min_alpha)
    if rule.nearest:
        return [int(np.argmax(solid))] if solid.any() else [-1]
    if not solid.any() and weight.sum() < rule.min_coverage:
        return [-1]
    light = {name: weight[names == name].sum() for name in np.unique(names[weight > 0]).tolist()}
    most = max(light.values())
    best = [name for name, amount in light.items() if amount > most - 1e-6]
    return [int(v) for v in np.flatnonzero(np.isin(names, best)) if weight[v] > 0]


@pytest.mark.parametrize("rule", [PickRule(), PickRule(0.6, 0.1, 0.3), PickRule(nearest=True)])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_winners_follow_the_rule_at_every_pixel(rule: PickRule, count: int) -> None:
    camera = small_camera()
    splats = random_splats(camera, 120, 3, seed=2)
    instances = np.random.default_rng(0).integers(1, count + 1, 120, np.uint32)
    found = evaluate_fragments(*splats.arrays()[:4], camera)
    weight = compute_fragment_weights(found, find_blended_fragments(found))
    winner = render_preview(*splats.arrays(), camera, rule=rule, instances=instances).winner
    right = np.zeros(winner.shape, bool)
    for y, x in np.ndindex(*winner.shape):
        fragments = found.raw_alphas[:, y, x], weight[:, y, x], splats.opacities[found.rows], instances[found.rows]
        places = expected_winner(*fragments, rule)
        right[y, x] = winner[y, x] in [-1 if place < 0 else found.rows[place] for place in places]
    # Two instances are counted exactly; of more, one that was ousted by a heavy splat starts afresh.
    assert right.mean() > (0.999 if count <= 2 or rule.nearest else 0.97)
    assert len(np.unique(winner)) > 20


def test_of_the_instance_that_wins_the_heaviest_splat_does() -> None:
    camera = small_camera()
    splats = plain_splats(camera, [[26, 18]] * 4, [2.0, 2.2, 2.4, 2.6], 12, 0.45)
    instances = np.array([7, 9, 9, 9], np.uint32)  # weights .45, .25, .14, .07
    winner = render_preview(*splats.arrays(), camera, instances=instances).winner[18, 26]
    contributors = find_pixel_contributors(*splats.arrays()[:4], camera, 26, 18)
    assert winner == pick_winner(contributors, instances=instances) == 1
    assert render_preview(*splats.arrays(), camera).winner[18, 26] == pick_winner(contributors) == 0


def test_numbers_of_instances_are_told_apart_up_to_24_bits() -> None:
    camera = small_camera()
    splats = plain_splats(camera, [[26, 18]] * 3, [2.0, 2.2, 2.4], 12, 0.4)
    instances = np.array([2**24 - 2, 2**24 - 1, 2**24 - 1], np.uint32)  # weights .4, .24, .144
    splats.opacities[0] = 0.38
    assert render_preview(*splats.arrays(), camera, instances=instances).winner[18, 26] == 1


def test_one_pixel_alone_agrees_with_the_frame() -> None:
    camera = small_camera(120, 80)
    splats = random_splats(camera, 900, 3, seed=3)
    rng = np.random.default_rng(0)
    instances = rng.integers(1, 6, 900, np.uint32)
    frame = render_preview(*splats.arrays(), camera, instances=instances)
    pixels = np.stack([rng.integers(0, 120, 400), rng.integers(0, 80, 400)], axis=1)
    agreeing = 0
    for x, y in pixels:
        contributors = find_pixel_contributors(*splats.arrays()[:4], camera, int(x), int(y))
        assert contributors.weights.sum() == pytest.approx(frame.alpha[y, x], abs=1e-5)
        assert (np.diff(contributors.depths) >= 0).all()
        blended = (contributors.weights[:, None] * splats.channels[contributors.rows]).sum(axis=0)
        np.testing.assert_allclose(blended, frame.color[y, x], atol=1e-5)
        agreeing += pick_winner(contributors, instances=instances) == frame.winner[y, x]
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
    nearest_wins = PickRule(nearest=True)
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
    assert frame.alpha[18, 26] > 0.5
    assert frame.winner[18, 26] == 0  # of equals the nearest is the heaviest
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
