"""Clusters planted in known places come back as instances."""

import numpy as np
import pytest

from instdrive_core.instances.components import ComponentConfig, split_components
from instdrive_core.instances.rejoining import RejoinConfig


class Planted:
    """Collects blobs of Gaussians and splits them."""

    def __init__(self, seed=0):
        self.rng = np.random.default_rng(seed)
        self.columns = {"means": [], "scales": [], "nodes": [], "codewords": [], "opacities": []}
        self.blobs = []

    def blob(self, center, codeword, count=100, radius=0.8, node=0, scale=0.03, opacity=0.6):
        """A shell of Gaussians; returns its rows."""
        directions = self.rng.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return self.add(center + radius * directions, codeword, node, scale, opacity)

    def add(self, means, codeword, node=0, scale=0.03, opacity=0.6):
        start, count = sum(len(part) for part in self.columns["means"]), len(means)
        self.columns["means"].append(np.asarray(means, np.float32))
        self.columns["scales"].append(np.full((count, 3), scale, np.float32))
        self.columns["nodes"].append(np.full(count, node, np.uint16))
        self.columns["codewords"].append(np.full(count, codeword, np.uint32))
        self.columns["opacities"].append(np.full(count, opacity, np.float32))
        return slice(start, start + count)

    def split(self, config=None):
        columns = {name: np.concatenate(parts) for name, parts in self.columns.items()}
        return split_components(**columns) if config is None else split_components(**columns, config=config)


def only(labels):
    """The one label that all share."""
    assert len(np.unique(labels)) == 1
    return int(labels[0])


def test_one_codeword_at_three_places_is_three_instances_ordered_by_size():
    planted = Planted()
    small, large, middle = (planted.blob([x, 0, 0], 5, count) for x, count in ((0, 100), (10, 300), (20, 200)))
    labels = planted.split()
    assert [only(labels[blob]) for blob in (large, middle, small)] == [1, 2, 3]
    assert labels.dtype == np.uint32


def test_parked_cars_with_one_codeword_are_two():
    planted = Planted()
    left, right = (planted.blob([0, y, 0], 5, 400, radius=1.0) for y in (0, 2.8))
    labels = planted.split()
    assert only(labels[left]) != only(labels[right])


def test_touching_things_of_two_codewords_and_two_nodes_stay_apart():
    planted = Planted()
    parts = [planted.blob([0, 0, 0], code, node=node) for code, node in ((5, 0), (6, 0), (5, 1), (5, 2))]
    labels = planted.split()
    assert sorted(only(labels[part]) for part in parts) == [1, 2, 3, 4]


def test_an_actor_is_not_split():
    planted = Planted()
    cab, trailer, load = (planted.blob([0, y, 0], code, node=3) for y, code in ((4, 5), (-4, 5), (-4, 6)))
    labels = planted.split()
    assert only(labels[cab]) == only(labels[trailer]) != only(labels[load])


def test_sparse_surface_of_large_gaussians_hangs_together():
    planted = Planted()
    grid = np.stack(np.meshgrid(np.arange(0, 60, 2.5), np.arange(0, 12, 2.5), [0]), axis=-1).reshape(-1, 3)
    road = planted.add(grid, 1, scale=1.0)
    assert only(planted.split()[road]) == 1


def test_far_apart_is_measured_by_the_scene_around():
    grid = np.stack(np.meshgrid(np.arange(0, 30, 2.5), np.arange(0, 12, 2.5), [0]), axis=-1).reshape(-1, 3)
    sparse = Planted()
    facade = sparse.add(grid, 1, scale=0.01)
    assert only(sparse.split()[facade]) == 1
    # The same places amid a dense surface of another codeword are strays on it.
    dense = Planted()
    ground = np.stack(np.meshgrid(np.arange(-1, 31, 0.25), np.arange(-1, 13, 0.25), [0.1]), axis=-1).reshape(-1, 3)
    road, strays = dense.add(ground, 2, scale=0.05), dense.add(grid, 1, scale=0.01)
    labels = dense.split()
    assert only(labels[strays]) == only(labels[road])


def test_clumps_of_cloned_gaussians_do_not_break_a_surface():
    planted = Planted()
    grid = np.stack(np.meshgrid(np.arange(0, 6, 0.4), np.arange(0, 6, 0.4), [0]), axis=-1).reshape(-1, 3)
    clones = np.repeat(grid, 20, axis=0) + planted.rng.normal(0, 1e-3, (20 * len(grid), 3))
    planted.add(clones, 1)
    assert only(planted.split()) == 1


def test_density_may_fall_along_an_object():
    planted = Planted()
    x = np.cumsum(np.geomspace(0.02, 0.6, 120))
    planted.add(np.stack([x, 0 * x, 0 * x], axis=1), 1, scale=0.02)
    assert only(planted.split()) == 1


def test_fragment_joins_the_nearest_component_of_its_codeword():
    planted = Planted()
    far, near = planted.blob([0, 0, 0], 5, 300), planted.blob([3.5, 0, 0], 5, 100)
    fragment = planted.blob([5.3, 0, 0], 5, 4, radius=0.05)
    labels = planted.split()
    assert only(labels[fragment]) == only(labels[near]) != only(labels[far])


def test_fragment_without_its_codeword_near_goes_to_its_surroundings():
    planted = Planted()
    car, other = planted.blob([0, 0, 0], 5, 400), planted.blob([0, 9, 0], 6, 400)
    stray = planted.add(planted.rng.normal([0.8, 0, 0], 0.05, (4, 3)), 77)
    assert only(planted.split()[stray]) == only(planted.split()[car]) != only(planted.split()[other])


def test_votes_never_cross_nodes():
    planted = Planted()
    planted.blob([0, 0, 0], 5, 400, node=1)
    stray = planted.add(planted.rng.normal([0.8, 0, 0], 0.05, (4, 3)), 77, node=2)
    assert only(planted.split()[stray]) == 0


def test_lone_fragments_get_no_instance():
    planted = Planted()
    car, floater = planted.blob([0, 0, 0], 5), planted.add([[0, 0, 30.0]], 5)
    labels = planted.split()
    assert (only(labels[car]), only(labels[floater])) == (1, 0)


def test_support_counts_opacity():
    planted = Planted()
    planted.blob([0, 0, 0], 5, 100, opacity=0.01)
    assert not planted.split().any()
    assert only(planted.split(ComponentConfig(min_support=0.5))) == 1


def test_order_of_rows_does_not_matter_and_runs_agree():
    planted = Planted(3)
    for code in range(8):
        planted.blob(planted.rng.uniform(-8, 8, 3), code % 3, 60)
    columns = {name: np.concatenate(parts) for name, parts in planted.columns.items()}
    labels = split_components(**columns)
    np.testing.assert_array_equal(labels, split_components(**columns))
    shuffle = planted.rng.permutation(len(labels))
    shuffled = split_components(**{name: column[shuffle] for name, column in columns.items()})
    pairs = set(zip(labels[shuffle].tolist(), shuffled.tolist(), strict=True))
    assert len(pairs) == len(np.unique(labels))


def test_damaged_rows_and_empty_scenes():
    planted = Planted()
    car = planted.blob([0, 0, 0], 5)
    planted.add([[np.nan, 0, 0], [0, np.inf, 0]], 5)
    labels = planted.split()
    assert only(labels[car]) == 1
    assert not labels[-2:].any()
    assert len(split_components(*(np.zeros(s, t) for s, t in EMPTY))) == 0


EMPTY = [((0, 3), np.float32), ((0, 3), np.float32), ((0,), np.uint16), ((0,), np.uint32), ((0,), np.float32)]


@pytest.mark.parametrize("stretch", [1e5, 1e7])
def test_strays_far_away_do_not_disturb(stretch):
    planted = Planted()
    cars = [planted.blob([x, 0, 0], 5, 200) for x in (0, 10)]
    planted.add([[stretch, -stretch, stretch]], 5)
    labels = planted.split()
    assert {only(labels[car]) for car in cars} == {1, 2}
    assert labels[-1] == 0


def plane(x, y, step=0.3, z=0.0):
    """Points on a level rectangle; x and y are (from, to) in metres."""
    return np.stack(np.meshgrid(np.arange(*x, step), np.arange(*y, step), [z]), axis=-1).reshape(-1, 3)


def test_a_road_behind_the_shadow_of_a_parked_car_stays_one():
    planted = Planted()
    near, far = planted.add(plane((0, 30), (0, 8)), 5), planted.add(plane((0, 12), (11, 16)), 5)
    car = planted.blob([6, 9.5, 0.9], 6, 400)
    labels = planted.split()
    assert only(labels[near]) == only(labels[far]) != only(labels[car])


@pytest.mark.parametrize("z", [1.5, 3.0])
def test_large_surfaces_in_different_planes_stay_apart(z):
    planted = Planted()
    road, roof = planted.add(plane((0, 30), (0, 8)), 5), planted.add(plane((0, 12), (10, 15), z=z), 5)
    labels = planted.split()
    assert only(labels[road]) != only(labels[roof])


def test_a_gap_longer_than_the_smaller_part_divides_even_a_plane():
    planted = Planted()
    road, island = planted.add(plane((0, 30), (0, 8)), 5), planted.add(plane((0, 6), (14, 20)), 5)
    labels = planted.split()
    assert only(labels[road]) != only(labels[island])


def test_parked_vans_in_a_row_stay_apart():
    planted = Planted()
    shell = planted.rng.uniform(-1, 1, (3000, 3)) * [1.0, 2.5, 0.95]
    vans = [planted.add(shell + np.array([0, y, 1.0]), 5) for y in (0, 7)]
    labels = planted.split()
    assert only(labels[vans[0]]) != only(labels[vans[1]])


def test_a_light_part_joins_across_a_gap_that_keeps_heavy_ones_apart():
    labels = {}
    for count in (20, 400):
        planted = Planted()
        car, part = planted.blob([0, 0, 0], 5, 600), planted.blob([4.5, 0, 0], 5, count, radius=0.4)
        split = planted.split()
        labels[count] = only(split[car]), only(split[part])
    assert labels[20][0] == labels[20][1]
    assert labels[400][0] != labels[400][1]


def test_a_light_part_between_two_heavy_ones_does_not_join_them():
    planted = Planted()
    left, right = planted.blob([0, 0, 0], 5, 400), planted.blob([5, 0, 0], 5, 500)
    between = planted.blob([2.3, 0, 0], 5, 20, radius=0.1)
    labels = planted.split()
    assert only(labels[left]) != only(labels[right])
    assert only(labels[between]) == only(labels[left])


def test_parts_that_join_a_part_end_with_the_largest():
    planted = Planted()
    parts = [planted.blob([x, 0, 0], 5, count, radius=0.4) for x, count in ((0, 600), (4, 25), (8, 20), (12, 15))]
    assert {only(planted.split()[part]) for part in parts} == {1}


def test_without_rejoining_gaps_divide():
    planted = Planted()
    car, part = planted.blob([0, 0, 0], 5, 600), planted.blob([4.5, 0, 0], 5, 20, radius=0.4)
    config = ComponentConfig(rejoin=RejoinConfig(gap_times_support=0.0, flat_extent=np.inf))
    labels = planted.split(config)
    assert only(labels[car]) != only(labels[part])
