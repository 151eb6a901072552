"""The mask graph: its rules on hand-made masks, and what it makes of a toy drive."""

from dataclasses import replace

import numpy as np

from instdrive_core.baselines.mask_consensus import (
    MaskGraphConfig,
    find_dropped_masks,
    link_by_average,
    link_masks,
    relate_masks,
)
from instdrive_core.baselines.mask_graph import cluster_masks, learn_mask_graph, vote_clusters
from instdrive_core.baselines.mask_members import MaskMembers
from instdrive_core.training.views.view_store import ViewStore

CONFIG = MaskGraphConfig()
LEFT, RIGHT = range(10), range(10, 20)
"""Two objects of ten Gaussians."""


def members_of(*photos):
    """Masks as lists of Gaussians, one pixel each; a Gaussian may be in several masks of a photo."""
    pixels = [
        np.array([(row, mask) for mask, members in enumerate(photo) for row in members], np.int64) for photo in photos
    ]
    return MaskMembers.from_pixels([(pairs[:, 0], pairs[:, 1]) for pairs in pixels], 20, 0.5)


def ids_of(of):
    return vote_clusters(of, cluster_masks(of))


def test_a_gaussian_belongs_to_the_mask_of_more_than_half_of_its_pixels():
    one, nothing = (np.array([0, 0, 0, 1, 1]), np.array([0, 0, 1, 0, 1])), (np.zeros(0, int), np.zeros(0, int))
    of = MaskMembers.from_pixels([one, nothing, (np.array([2, 0]), np.array([0, 0]))], 4, 0.5)
    expected = [[1, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0]]  # the second is seen, but half of it is not enough
    np.testing.assert_array_equal(of.members.toarray(), expected)
    np.testing.assert_array_equal(of.seen.toarray(), [[1, 1], [1, 0], [0, 1], [0, 0]])
    assert of.view_of_mask.tolist() == [0, 0, 1]


def test_two_objects_over_several_photos_are_two_clusters():
    ids = ids_of(members_of(*[[LEFT, RIGHT]] * 4))
    assert (ids[:10] == 0).all()
    assert (ids[10:] == 1).all()


def test_a_split_and_a_merged_mask_are_outvoted_and_a_missing_one_says_nothing():
    whole = [LEFT, RIGHT]
    split, merged, missing = [range(5), range(5, 10), RIGHT], [range(20)], [RIGHT]
    of = members_of(whole, split, whole, merged, missing, whole, whole)
    ids = ids_of(of)
    assert (ids[:10] == ids[0]).all()
    assert (ids[10:] == ids[10]).all()
    assert ids[0] != ids[10]
    clusters = cluster_masks(of)
    assert clusters[[0, 2, 3, 5, 9, 11]].tolist() == [ids[0]] * 6, "halves join what contains them"
    assert clusters[7] not in (ids[0], ids[10]), "the merged mask joins neither"


def test_a_mask_never_contained_is_dropped_and_its_photo_says_nothing_of_what_it_held():
    of = members_of([range(20)], *[[LEFT, RIGHT]] * 5)
    relations = relate_masks(of, CONFIG)
    assert find_dropped_masks(relations, CONFIG).tolist() == [True] + [False] * 10
    assert relations.observed[1].sum() == 6
    rest = relations.exclude(np.arange(11) == 0)
    assert rest.observed[0].tolist() == [False] + [True] * 5
    assert rest.contained.sum(axis=1).tolist() == [5] * 10
    tolerant = replace(CONFIG, uncontained_share=0.9)
    assert not find_dropped_masks(relations, tolerant).any()


def test_a_mask_that_its_own_photo_alone_observes_stays():
    of = members_of([LEFT], [RIGHT])
    assert not find_dropped_masks(relate_masks(of, CONFIG), CONFIG).any()
    assert cluster_masks(of).tolist() == [0, 1]


def test_a_photo_observes_from_three_tenths_and_a_mask_contains_from_six_tenths():
    relations = relate_masks(members_of([LEFT], [range(3)], [range(2)]), CONFIG)
    assert relations.observed[0].tolist() == [True, True, False]
    six, five = range(6), range(5)
    relations = relate_masks(members_of([LEFT], [six, range(6, 10)], [five, range(5, 10)]), CONFIG)
    assert relations.observed[0].all()
    assert relations.contained.toarray()[0].tolist() == [1, 1, 0, 0, 0]


def test_consensus_is_support_over_observers_plus_one():
    relations = relate_masks(members_of([LEFT], [LEFT], [range(5), range(5, 10)]), CONFIG)
    both = np.arange(2)
    np.testing.assert_allclose(relations.consensus(both, both), np.full((2, 2), 2 / 4))


def test_linkage_takes_the_mean_over_all_pairs_and_stops_at_its_limit():
    def chain(weak):
        """Two close pairs; between them the four similarities' mean is (0.7 + 3 weak) / 4."""
        similarities = np.full((4, 4), weak, np.float32)
        similarities[:2, :2] = similarities[2:, 2:] = 0.9
        similarities[1, 2] = similarities[2, 1] = 0.7
        return similarities

    assert len(np.unique(link_by_average(chain(0.43), 0.5))) == 2
    assert len(np.unique(link_by_average(chain(0.44), 0.5))) == 1
    exactly = np.array([[1, 0.5], [0.5, 1]], np.float32)
    assert link_by_average(exactly, 0.5).tolist() == [0, 0]
    assert len(np.unique(link_by_average(exactly - np.float32(1e-3), 0.5))) == 2


def test_linking_each_component_alone_is_linking_everything():
    rng = np.random.default_rng(0)
    views = [[rng.permutation(20)[: rng.integers(3, 12)] for _ in range(3)] for _ in range(12)]
    relations = relate_masks(members_of(*views), CONFIG)
    everything = np.arange(36)
    config = replace(CONFIG, linkage_stop=0.35)
    expected = link_by_average(relations.consensus(everything, everything), config.linkage_stop)
    groups = link_masks(relations, config)
    assert 1 < len(np.unique(expected)) < 36
    pairs = np.unique(np.stack([groups, expected]), axis=1)
    assert pairs.shape[1] == len(np.unique(expected)) == len(np.unique(groups))


def test_most_masks_win_and_ties_go_to_the_lower_cluster():
    of = members_of([range(3)], [range(2)], [range(1)])
    assert vote_clusters(of, np.array([1, 0, 0]))[:4].tolist() == [0, 0, 1, -1]
    assert vote_clusters(of, np.array([-1, -1, 0]))[:4].tolist() == [0, -1, -1, -1]


def test_it_beats_random_ids_by_far_and_repeats_to_the_bit(toy):
    notes = []
    first = learn_mask_graph(toy.model, toy.store, toy.config, notes.append)
    random_ids = np.random.default_rng(0).integers(1, 5, len(toy.model))
    assert toy.scene_miou(first.codewords) >= toy.scene_miou(random_ids) + 0.3
    assert (first.codewords > 0).all()
    assert notes
    second = learn_mask_graph(toy.model, toy.store, toy.config, notes.append)
    np.testing.assert_array_equal(first.codewords, second.codewords)
    assert first.code_bits == 0
    assert not first.whole
    assert first.features.shape == (len(toy.model), 1)


def test_where_no_view_shows_a_mask_there_is_one_code_and_a_note(toy):
    views = [replace(toy.store.get(number), labels=None) for number in range(len(toy.store))]
    notes = []
    learned = learn_mask_graph(toy.model, ViewStore.from_views(views), toy.config, notes.append)
    assert (learned.codewords == 0).all()
    assert len(learned.features) == len(toy.model)
    assert "no view" in notes[0]
