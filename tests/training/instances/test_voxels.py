"""Grouping by voxels against the definition."""

import numba
import numpy as np
import pytest

from instdrive_core.training.instances.voxels import Voxels, group_by_voxel


def voxel_of_each(voxels: Voxels) -> list[int]:
    owner = np.empty(len(voxels.order), int)
    for number, (start, stop) in enumerate(zip(voxels.starts[:-1], voxels.starts[1:], strict=True)):
        owner[voxels.order[start:stop]] = number
    return owner.tolist()


def test_voxels_never_join_nodes_and_follow_the_offset():
    positions = np.array([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.2, 0.1, 0.1], [0.6, 0.1, 0.1]], np.float32)
    nodes = np.array([0, 0, 1, 0], np.uint16)
    still = voxel_of_each(group_by_voxel(positions, nodes, 0.5, np.zeros(3)))
    assert still[0] == still[1]
    assert still[2] not in (still[0], still[3])
    assert still[3] != still[0]
    shifted = voxel_of_each(group_by_voxel(positions, nodes, 0.5, np.array([0.35, 0, 0])))
    assert shifted[3] == shifted[1] != shifted[0]


@pytest.mark.parametrize("count", [1, 5, 3_000, 40_000])
def test_voxels_are_those_of_the_definition(count: int):
    rng = np.random.default_rng(count)
    positions = rng.normal(0, 8, (count, 3)).astype(np.float32)
    positions[0] = [3e4, -2e4, 1e4]  # one far away must not cost room for all cells between
    nodes, offset = rng.integers(0, 3, count).astype(np.uint16), rng.uniform(0, 0.7, 3)
    voxels = group_by_voxel(positions, nodes, 0.7, offset)
    cells = np.column_stack([nodes, np.floor((positions + offset) / 0.7)])
    expected: dict[tuple, list[int]] = {}
    for row, cell in enumerate(cells):
        expected.setdefault(tuple(cell), []).append(row)
    found = [voxels.order[a:b].tolist() for a, b in zip(voxels.starts[:-1], voxels.starts[1:], strict=True)]
    assert sorted(found) == sorted(expected.values())


def test_the_order_is_the_same_with_any_number_of_threads():
    positions = np.random.default_rng(0).normal(0, 9, (50_000, 3)).astype(np.float32)
    results = []
    threads = numba.get_num_threads()
    for number in (1, threads):
        numba.set_num_threads(number)
        results.append(group_by_voxel(positions, np.zeros(50_000, np.uint16), 0.5, np.full(3, 0.2)))
    assert np.array_equal(results[0].order, results[1].order)
    assert np.array_equal(results[0].starts, results[1].starts)
