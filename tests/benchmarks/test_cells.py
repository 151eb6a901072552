"""The plan of the tables' cells: names, needs, keys, configurations."""

from dataclasses import replace

import pytest

from benchmarks.cells import (
    ABLATIONS,
    FULL,
    HEADLINE_SEEDS,
    MINIATURE,
    PANDASET,
    STREET,
    TUNED_ON,
    Cell,
    build_cell_config,
    cell_keys,
    choose_cells,
    plan,
)
from instdrive_core.errors import OptionError
from instdrive_core.training.instances import mask_weights
from instdrive_core.training.settings.config import build_train_config, keep_geometry

CELLS = plan()
BY_NAME = {cell.name: cell for cell in CELLS}


def keys(cells=CELLS, scale=FULL, recorded="clip"):
    return cell_keys(cells, scale, recorded)


def test_names_are_unique_and_needs_come_first():
    assert len(BY_NAME) == len(CELLS)
    seen = set()
    for cell in CELLS:
        assert set(cell.needs) <= seen
        seen.add(cell.name)


def test_the_whole_is_expected_to_take_four_and_a_half_hours_at_most():
    assert 3_600 < sum(cell.seconds for cell in CELLS if not cell.optional) <= 16_200
    assert sum(cell.seconds for cell in plan(MINIATURE) if not cell.optional) < 3_600


def test_all_comparisons_are_there():
    for cameras in "136":
        for method in ("gaussian-grouping", "opengaussian", "mask-graph", "paper", "instdrive"):
            assert f"{STREET}/{cameras}/sam-v1/{method}" in BY_NAME
    for method in ("gaussian-grouping", "opengaussian", "mask-graph", "paper", "instdrive"):
        assert f"{PANDASET}/6/annotations/{method}" in BY_NAME
    assert {f"{PANDASET}/6/lidar/instdrive", f"{PANDASET}/6/lidar/opengaussian"} <= set(BY_NAME)


def test_nothing_was_chosen_on_the_streets_of_the_headline():
    assert len(HEADLINE_SEEDS) == 2
    assert not set(HEADLINE_SEEDS) & set(TUNED_ON)


def test_the_papers_own_length_is_done_where_it_is_asked_for():
    name = f"street-{HEADLINE_SEEDS[0]}/6/sam-v1/paper+full"
    assert name not in {cell.name for cell in choose_cells(CELLS, ())}
    assert name in {cell.name for cell in choose_cells(CELLS, (), optional=True)}
    assert name in {cell.name for cell in choose_cells(CELLS, (name,))}
    long, short = (build_cell_config(BY_NAME[each], FULL) for each in (name, name.removesuffix("+full")))
    assert long == replace(short, instances=replace(short.instances, iterations=30_000))
    assert build_cell_config(BY_NAME[name], MINIATURE).instances.iterations < 1_000


@pytest.mark.parametrize("method", ["gaussian-grouping", "opengaussian", "paper"])
def test_other_methods_see_as_many_pixels_as_ours(method):
    instances = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/{method}"], FULL).instances
    assert instances.pixels_per_view == mask_weights.PIXELS_PER_VIEW


def test_all_methods_of_a_place_learn_on_the_same_geometry_and_masks():
    for cell in CELLS:
        if cell.kind == "method":
            assert cell.needs == (f"{cell.clip}/{cell.cameras}/geometry", f"{cell.clip}/{cell.masks}", cell.clip)


def test_a_method_trains_on_frozen_geometry_and_the_geometry_as_the_command_line_does():
    assert build_cell_config(BY_NAME[f"{STREET}/6/geometry"], FULL) == build_train_config("instdrive", "quick")
    ours = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/instdrive"], FULL)
    assert ours.instances == build_train_config("instdrive", "quick").instances
    assert ours.freeze_geometry
    printed = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/paper"], FULL)
    expected = keep_geometry(build_train_config("paper", "quick"))
    as_ours = replace(expected.instances, whole_actors=True, pixels_per_view=mask_weights.PIXELS_PER_VIEW)
    assert printed == replace(expected, instances=as_ours)


@pytest.mark.parametrize(
    ("change", "field", "expected"),
    [
        ("no-voxel", "voxel_weight", 0.0),
        ("no-pseudo", "pseudo_weight", 0.0),
        ("d6", "feature_dim", 6),
        ("d10", "feature_dim", 10),
    ],
)
def test_an_ablation_changes_one_thing(change, field, expected):
    base = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/paper+scaled"], FULL)
    changed = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/paper+scaled+{change}"], FULL)
    assert getattr(changed.instances, field) == expected != getattr(base.instances, field)
    assert changed == replace(base, instances=replace(base.instances, **{field: expected}))


def test_ablations_of_ours_train_its_losses():
    ours = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/instdrive+losses+no-pseudo"], FULL).instances
    assert (ours.learned_by, ours.pseudo_weight) == ("losses", 0.0)
    assert build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/paper+scaled+d6"], FULL).instances.learned_by == "losses"


def test_how_instances_are_learned_leaves_the_geometry_as_it_is(monkeypatch):
    def other_voxels(*words):
        config = build_train_config(*words)
        return replace(config, instances=replace(config.instances, voxel_size=9.0))

    before = keys()
    monkeypatch.setattr("benchmarks.cells.build_train_config", other_voxels)
    after = keys()
    changed = {name for name in before if before[name] != after[name]}
    assert changed
    assert {BY_NAME[name].kind for name in changed} == {"method", "figure"}


def test_the_scaled_rate_keeps_rate_times_steps():
    printed = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/paper"], FULL).instances
    scaled = build_cell_config(BY_NAME[f"{STREET}/6/sam-v1/paper+scaled"], FULL).instances
    assert scaled.feature_lr * scaled.iterations == pytest.approx(printed.feature_lr * 30_000)


def test_an_unknown_variant_is_refused():
    with pytest.raises(OptionError, match=ABLATIONS[0]):
        build_cell_config(Cell("x", "method", STREET, variant="no-such"), FULL)


def test_keys_differ_by_settings_and_follow_what_a_cell_needs():
    at_full, at_miniature = keys(), keys(scale=MINIATURE)
    assert len(set(at_full.values())) == len(CELLS)
    assert not set(at_full.values()) & set(at_miniature.values())
    elsewhere = keys(recorded="other clip")
    changed = {name for name in at_full if at_full[name] != elsewhere[name]}
    assert changed == {cell.name for cell in CELLS if cell.clip == PANDASET}


def test_only_what_a_pattern_names_and_needs_is_chosen():
    names = [cell.name for cell in choose_cells(CELLS, ["3/sam-v1/opengaussian"])]
    street = [STREET, f"{STREET}/sam-v1", f"{STREET}/3/geometry"]
    assert names == [*street, f"{STREET}/3/sam-v1/opengaussian"]
    assert choose_cells(CELLS, [], optional=True) == CELLS
    figures = {cell.name for cell in choose_cells(CELLS, ["figure/lidar*"])}
    assert f"{STREET}/6/sam-v1/instdrive+losses+no-voxel" in figures
    with pytest.raises(OptionError, match="--list"):
        choose_cells(CELLS, ["no such cell"])
