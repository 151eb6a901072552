"""Faults that repeat over photos: on a street of its own, photo by photo."""

import json
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.units import CONFIG_FILE, GROUND, StreetUnits
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import DataError, OptionError
from instdrive_core.masks.exact import ExactLabels
from instdrive_core.masks.faults.draws import RepeatedDraws
from instdrive_core.masks.faults.registry import FAULT_SETS, find_fault_set
from instdrive_core.masks.label_map_folder import open_masks
from instdrive_core.masks.making import make_masks


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("faults") / "clip"
    write_street(path, StreetConfig(seed=5, steps=3, width=240, height=135, lidar_azimuths=16))
    return path


@pytest.fixture(scope="module")
def clip(folder):
    return load_clip(str(folder), ClipOptions(scale=1.0))


@pytest.fixture(scope="module")
def masks(clip):
    """All photos by the strength of the faults."""
    sources = {name: find_fault_set(name).open(clip, ExactLabels(clip.path), 0) for name in ("sam-v2", "sam-v2-strong")}
    return {name: {frame.key: source.load(frame) for frame in clip.frames} for name, source in sources.items()}


def unmasked_share(found):
    bare = sum(int(((photo.labels == 0) & ~photo.sky).sum()) for photo in found.values())
    return bare / sum(int((~photo.sky).sum()) for photo in found.values())


def test_draws_are_uniform_and_repeat_but_for_the_flipped_ones():
    keys = np.arange(4000)
    first, second = (RepeatedDraws(7, photo, 0.1).draw("part", keys, 3) for photo in ("a/00", "a/01"))
    assert abs(first.mean() - 0.5) < 0.02
    assert 0.75 < (first == second).mean() < 0.87  # 0.9 · 0.9
    always = RepeatedDraws(7, "a/00", 0.0)
    np.testing.assert_array_equal(always.draw("part", keys), RepeatedDraws(7, "b/05", 0.0).draw("part", keys))
    assert (always.draw("part", keys) == always.draw("whole", keys)).mean() < 0.01
    assert (always.draw("part", keys) == RepeatedDraws(8, "a/00", 0.0).draw("part", keys)).mean() < 0.01


def test_units_agree_with_the_exact_labels(clip):
    units, exact = StreetUnits(clip.path), ExactLabels(clip.path)
    shaded, lit = [], []
    for frame in clip.frames[:6]:
        view = frame.view
        seen = units.look(view.name, view.index, view.camera.width, view.camera.height)
        known = exact.load(frame)
        assert (seen.objects == known)[known > 0].mean() > 0.9  # one ray a pixel instead of four
        shows_ground = (units.families[seen.objects] == GROUND) & (seen.objects > 0)
        np.testing.assert_array_equal(seen.cells > 0, shows_ground)
        light, is_asphalt = (
            np.asarray(Image.open(frame.view.photo), float).mean(axis=2),
            (seen.cells > 0) & (seen.coarse == 1),
        )
        shaded += list(light[is_asphalt & (seen.casters > 0)])
        lit += list(light[is_asphalt & (seen.casters == 0)])
    assert np.median(lit) > 1.3 * np.median(shaded)


def test_a_third_of_the_photo_lies_in_no_mask_and_more_where_faults_are_strong(masks):
    assert 0.2 < unmasked_share(masks["sam-v2"]) < 0.5
    assert unmasked_share(masks["sam-v2-strong"]) > unmasked_share(masks["sam-v2"]) + 0.05


def test_the_second_layer_has_larger_masks_on_top(masks):
    finer = 0
    for photo in masks["sam-v2"].values():
        (large,) = photo.overlaps
        np.testing.assert_array_equal(photo.labels > 0, large > 0)
        assert photo.labels.max() < 2000
        finer += len(np.unique(photo.labels)) >= len(np.unique(large))
    assert finer > 0.9 * len(masks["sam-v2"])


def test_what_happens_to_an_object_in_one_photo_happens_to_it_in_the_next(clip, masks):
    """Whether it is bare repeats far more often than if each photo drew anew."""
    exact, pairs = ExactLabels(clip.path), []
    for name in {frame.view.name for frame in clip.frames}:
        bare = []
        for frame in (frame for frame in clip.frames if frame.view.name == name):
            known, found = exact.load(frame).ravel(), masks["sam-v2"][frame.key].labels.ravel()
            areas = np.bincount(known)
            shares = np.bincount(known, weights=found > 0) / np.maximum(areas, 1)
            bare.append({int(number): shares[number] < 0.3 for number in np.flatnonzero(areas > 150) if number})
        for first, second in pairwise(bare):
            pairs += [(first[number], second[number]) for number in first.keys() & second.keys()]
    states = np.array(pairs)
    by_chance = states.mean() ** 2 + (1 - states.mean()) ** 2
    assert len(states) >= 40
    assert (states[:, 0] == states[:, 1]).mean() > (1 + by_chance) / 2


def test_masks_are_written_with_both_layers_and_read_again(clip, tmp_path):
    written = make_masks(clip, "exact", tmp_path / "m", seed=3, faults="sam-v2")
    opened = open_masks(tmp_path / "m")
    assert written.layers == opened.layers == 2
    frame = clip.training_frames[0]
    once, twice = opened.load(frame), find_fault_set("sam-v2").open(clip, ExactLabels(clip.path), 3).load(frame)
    np.testing.assert_array_equal(once.labels, twice.labels)
    np.testing.assert_array_equal(once.overlaps[0], twice.overlaps[0])
    (tmp_path / "m" / f"{frame.key}_layer1.png").unlink()
    with pytest.raises(DataError, match=r"_layer1\.png"):
        opened.load(frame)
    sidecar = json.loads((tmp_path / "m" / "masks.json").read_text())
    (tmp_path / "m" / "masks.json").write_text(json.dumps(sidecar | {"layers": 999}))
    with pytest.raises(DataError, match="'layers' is 999"):
        open_masks(tmp_path / "m")


@pytest.mark.parametrize("known", FAULT_SETS, ids=lambda known: known.name)
def test_every_set_of_faults_says_what_it_does_and_repeats_its_masks(known, clip):
    assert known.summary
    frame = clip.frames[0]
    one, other = (known.open(clip, ExactLabels(clip.path), 1).load(frame) for _ in range(2))
    np.testing.assert_array_equal(one.labels, other.labels)
    assert one.labels.any()


def test_only_a_synthetic_clip_that_keeps_its_street_can_be_damaged_so(clip, folder, tmp_path):
    with pytest.raises(OptionError, match="--source exact"):
        make_masks(clip, "annotations", tmp_path / "a", faults="sam-v2")
    file = folder / CONFIG_FILE
    kept = file.read_text()
    try:
        file.write_text(json.dumps(json.loads(kept) | {"steps": "many"}))
        with pytest.raises(DataError, match=r"street\.json"):
            StreetUnits(folder)
        file.unlink()
        with pytest.raises(DataError, match="instdrive synth"):
            StreetUnits(folder)
    finally:
        file.write_text(kept)
