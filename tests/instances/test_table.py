from dataclasses import replace

import numpy as np

from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.instances.table import InstanceTable, build_instance_table

IDS = np.array([7, 0, 7, 3, 7], np.uint32)
MEANS = np.arange(15, dtype=np.float32).reshape(5, 3)


def test_counts_bounds_names_and_classes():
    codewords = np.array([5, 1, 6, 2, 6], np.uint32)
    nodes = np.array([0, 0, 0, 2, 0], np.uint16)
    table = build_instance_table(IDS, MEANS, codewords, nodes, names={7: "bus"}, classes={3: "Car"})
    assert [instance.id for instance in table] == [3, 7]
    car, bus = table[3], table[7]
    assert (car.name, car.class_name, car.count, car.node, car.codeword) == ("instance 3", "Car", 1, 2, 2)
    assert (bus.name, bus.class_name, bus.count, bus.node, bus.codeword) == ("bus", "", 3, 0, 6)
    assert bus.bounds == ((0, 1, 2), (12, 13, 14))
    assert ids_from_colors(np.array([bus.color], np.uint8)).tolist() == [7]


def test_codeword_is_the_most_frequent_then_the_lowest():
    table = build_instance_table(np.array([1, 1, 1, 2, 2], np.uint32), MEANS, np.array([9, 4, 4, 8, 5], np.uint32))
    assert (table[1].codeword, table[2].codeword) == (4, 5)


def test_strays_in_another_node_change_neither_node_nor_bounds():
    ids, nodes = np.full(5, 1, np.uint32), np.array([0, 3, 3, 3, 0], np.uint16)
    table = build_instance_table(ids, MEANS, None, nodes)
    assert (table[1].node, table[1].count) == (3, 5)
    assert table[1].bounds == ((3, 4, 5), (9, 10, 11))


def test_instances_are_replaced():
    table = build_instance_table(IDS, MEANS)
    assert table[7].name == "instance 7"
    renamed = replace(table[7], name="tram")
    table.set(renamed)
    assert table[7] == renamed
    assert 7 in table
    assert 0 not in table
    assert len(table) == 2


def test_no_instances():
    assert len(build_instance_table(np.zeros(3, np.uint32), MEANS[:3], np.zeros(3, np.uint32))) == 0
    assert list(InstanceTable()) == []


def test_a_few_strays_do_not_stretch_the_bounds():
    means = np.random.default_rng(0).uniform(-1, 1, (200, 3)).astype(np.float32)
    means[:4] = 40.0
    low, high = build_instance_table(np.full(200, 5, np.uint32), means)[5].bounds
    assert max(high) < 1
    assert min(low) > -1
    assert max(low) < -0.8
    assert min(high) > 0.8
