"""Every registered source of masks and kind of ground truth: what it needs, how it is opened, where it is listed."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from painted_street import painted_clip
from small_clip import HEIGHT, WIDTH, write_exact_labels, write_small_clip
from tiny_sam import permissive

from instdrive_app.main import main
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.masks.ground_truth import GROUND_TRUTHS, NOT_KNOWN, find_ground_truth, open_ground_truth
from instdrive_core.masks.making import make_masks
from instdrive_core.masks.sources import MASK_SOURCES, SourceOptions, open_mask_source

BY_NAME = {source.name: source for source in MASK_SOURCES}
DOCUMENTED = Path(__file__).parents[2] / "docs" / "masks.md"


@pytest.fixture
def clip(tmp_path):
    """A clip that has all that any source needs."""
    return load_clip(str(write_exact_labels(write_small_clip(tmp_path / "clip"))), ClipOptions())


@pytest.fixture
def options(clip, tmp_path, sam_folder):
    make_masks(clip, "exact", tmp_path / "elsewhere")
    return SourceOptions(tmp_path / "elsewhere", permissive(sam_folder))


@pytest.mark.parametrize("name", BY_NAME)
def test_a_source_makes_masks_of_a_clip_that_has_what_it_needs(name, clip, options):
    assert BY_NAME[name].fits(clip)
    labels = open_mask_source(clip, name, options)
    frame = clip.training_frames[0]
    assert labels.source == name
    found, sky = labels.load(frame), labels.load_sky(frame)
    assert found.shape == sky.shape == (HEIGHT, WIDTH)
    assert not found[sky].any()
    for other in (found, sky):
        again = labels.load(frame) if other is found else labels.load_sky(frame)
        np.testing.assert_array_equal(again, other)


@pytest.mark.parametrize("name", BY_NAME)
def test_photos_alone_are_enough_or_what_is_missing_is_named(name):
    photos, source = dataclasses.replace(painted_clip("nowhere"), sweeps=()), BY_NAME[name]
    assert source.fits(photos) == (source.needs == "")
    if source.needs:
        with pytest.raises(DataError, match="Use --source sam or import") as error:
            open_mask_source(photos, name)
        assert f"has no {source.needs}" in str(error.value)


@pytest.mark.parametrize("name", BY_NAME)
def test_options_that_make_other_masks_are_part_of_the_recipe(name, options):
    listed = BY_NAME[name].list_options(options)
    assert bool(listed) == (name in ("sam", "import"))
    other = SourceOptions(Path("other"), dataclasses.replace(options.sam, overlap=0.25))
    assert (BY_NAME[name].list_options(other) != listed) == bool(listed)


def test_help_and_docs_list_every_source(capsys):
    assert len(BY_NAME) == len(MASK_SOURCES)
    assert main(["masks", "--help"]) == 0
    printed = "".join(capsys.readouterr().out.replace("│", " ").split())
    rows = DOCUMENTED.read_text(encoding="utf-8").splitlines()
    for source in MASK_SOURCES:
        assert "".join(f"`{source.name}`: {source.summary}".split()) in printed, "however lines are broken"
        assert any(row.startswith((f"| `{source.name}`", f"| [`{source.name}`]")) for row in rows), source.name


def test_an_unknown_source_is_answered_with_all():
    with pytest.raises(OptionError, match="exact, annotations, lidar, sam or import"):
        open_mask_source(painted_clip("nowhere"), "guess")


def test_the_most_exact_ground_truth_is_taken(clip):
    names = [kind.name for kind in GROUND_TRUTHS]
    assert names == ["exact", "annotations", NOT_KNOWN]
    assert find_ground_truth(clip).source == open_ground_truth(clip).source == "exact"
    for kind in GROUND_TRUTHS:
        assert kind.fits(clip)
        truth = kind.open(clip)
        assert truth.source == kind.name
        assert truth.load(clip.frames[0]).shape == (HEIGHT, WIDTH)
    photos = dataclasses.replace(painted_clip("nowhere"), sweeps=())
    assert find_ground_truth(photos).source == NOT_KNOWN
    with pytest.raises(DataError, match="has no annotations"):
        open_ground_truth(photos)
