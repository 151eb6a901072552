"""Each oddity is found in the rows that have it, and nothing is found in a sound scene."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scene import random_gaussians, random_scene

from instdrive_core.scene.gaussians import create_empty_gaussians
from instdrive_core.scene.lint import find_defects
from instdrive_core.scene.scene import scene_from_gaussians


def sound_scene(count=300, **options):
    """Every splat visible, small, of its own; an opacity of 0.5 or more."""
    gaussians = random_gaussians(np.random.default_rng(1), count, **options)
    gaussians.opacity_logits[:] = np.abs(gaussians.opacity_logits)
    return scene_from_gaussians(gaussians)


def only_finding(scene):
    findings = find_defects(scene)
    assert len(findings) == 1, [finding.what for finding in findings]
    assert findings[0].remedy
    return findings[0]


def test_a_sound_scene_has_no_findings():
    assert find_defects(sound_scene()) == ()
    assert find_defects(scene_from_gaussians(create_empty_gaussians())) == ()
    assert find_defects(scene_from_gaussians(create_empty_gaussians(15, 4))) == ()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["means", "quats", "log_scales", "sh_dc", "sh_rest", "features"])
def test_values_that_are_not_finite_are_found_in_every_array(name, value):
    scene = sound_scene()
    array = getattr(scene.gaussians, name)
    array[17].flat[-1] = value
    array[200].flat[0] = value
    finding = only_finding(scene)
    assert finding.kind == "not_finite"
    assert finding.rows.tolist() == [17, 200]
    assert f"{name} of 2" in finding.what


def test_opacities_of_zero_and_one_are_numbers_but_zero_never_shows():
    scene = sound_scene()
    scene.gaussians.opacity_logits[[3, 4, 5]] = [np.inf, -np.inf, np.nan]
    broken, hidden = find_defects(scene)
    assert (broken.kind, broken.rows.tolist()) == ("not_finite", [5])
    assert (hidden.kind, hidden.rows.tolist()) == ("never_shown", [4])


def test_opacities_are_compared_with_one_step_of_a_picture():
    scene = sound_scene()
    for row, opacity in enumerate([0.9 / 255, 1.1 / 255]):
        scene.gaussians.opacity_logits[row] = np.log(opacity / (1 - opacity))
    finding = only_finding(scene)
    assert (finding.kind, finding.rows.tolist()) == ("never_shown", [0])


def test_rotations_without_a_direction():
    scene = sound_scene()
    scene.gaussians.quats[8] = 0
    scene.gaussians.quats[9] = [0, 1e-30, 0, 0]
    scene.gaussians.quats[10] *= 1e-3
    finding = only_finding(scene)
    assert (finding.kind, finding.rows.tolist()) == ("zero_quaternion", [8, 9])


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_giants_and_outliers_are_measured_by_the_scene(unit):
    scene = sound_scene()
    scene.gaussians.means *= np.float32(unit)
    scene.gaussians.log_scales += np.float32(np.log(unit))
    assert find_defects(scene) == ()
    scene.gaussians.log_scales[20, 1] = np.log(50 * unit)
    scene.gaussians.means[30] = [0, 0, -1000 * unit]
    scene.gaussians.means[31] = [40 * unit, 0, 0]
    giant, outlier = find_defects(scene)
    assert (giant.kind, giant.rows.tolist()) == ("giant_scale", [20])
    assert (outlier.kind, outlier.rows.tolist()) == ("far_outlier", [30])


def test_scales_beyond_any_number_are_giant():
    scene = sound_scene()
    scene.gaussians.log_scales[20] = 1e30
    assert only_finding(scene).kind == "giant_scale"


def test_scenes_without_an_extent_are_not_measured():
    few = sound_scene(count=5)
    few.gaussians.means[0] = 1e9
    assert find_defects(few) == ()
    point = sound_scene()
    point.gaussians.means[:] = 7
    assert find_defects(point) == ()


def test_actors_are_not_measured_by_the_background():
    scene = random_scene(count=400)
    scene.gaussians.opacity_logits[:] = 1
    scene.gaussians.means[scene.nodes > 0] += 1e6
    assert find_defects(scene) == ()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 39), st.integers(0, 39)), max_size=12))
def test_repeats_are_the_later_rows_of_equal_ones(copies):
    scene = sound_scene(count=40)
    for source, target in copies:
        for array in scene.gaussians.arrays().values():
            array[target] = array[source]
    seen, expected = set(), []
    for row in range(40):
        key = scene.gaussians.means[row].tobytes()
        if key in seen:
            expected.append(row)
        seen.add(key)
    found = [finding for finding in find_defects(scene) if finding.kind == "duplicate"]
    assert [finding.rows.tolist() for finding in found] == ([expected] if expected else [])


def test_splats_that_share_a_place_only_are_no_repeats():
    scene = sound_scene()
    scene.gaussians.means[1] = scene.gaussians.means[0]
    scene.gaussians.quats[1] = scene.gaussians.quats[0]
    assert find_defects(scene) == ()


@pytest.mark.parametrize(("used", "empty"), [(0, 15), (1, 12), (3, 12), (4, 7), (8, 7), (9, 0), (15, 0)])
def test_sh_that_is_never_used(used, empty):
    scene = sound_scene()
    scene.gaussians.sh_rest[:, used:] = 0
    if not empty:
        assert find_defects(scene) == ()
        return
    finding = only_finding(scene)
    assert (finding.kind, finding.count, len(finding.rows)) == ("empty_sh", empty, 0)


def test_many_splats_take_less_time_than_sorting_them_by_place_twice():
    """A million: a quarter of a second, 0.6 times as much as sorting them."""
    scene = sound_scene(count=300_000, features=0)
    linting, sorting = [], []
    for _ in range(4):
        linting.append(cpu_seconds(lambda: find_defects(scene)))
        sorting.append(cpu_seconds(lambda: np.lexsort(scene.gaussians.means.T)))
    assert min(linting) < 2 * min(sorting)


def cpu_seconds(call):
    start = time.process_time()
    call()
    return time.process_time() - start


def test_one_splat_is_told_of_in_the_singular():
    for count, told in ((1, "1 splat has a rotation of length 0"), (2, "2 splats have a rotation of length 0")):
        scene = sound_scene()
        scene.gaussians.quats[:count] = 0
        assert only_finding(scene).what == told
