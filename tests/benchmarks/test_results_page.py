"""docs/results.md from outcomes."""

import json
import re

import pytest

from benchmarks.cells import HEADLINE_SEEDS, PANDASET, PUBLISHED_TOO, STREET, plan
from benchmarks.outcomes import PUBLISHED, SPLIT, Results, format_spread, format_value, ratio, table, value
from benchmarks.results_page import NOTES_END, NOTES_START, oracle_key, page, voxel_sentence
from benchmarks.results_targets import TARGETS, targets_table
from benchmarks.tables import read_notes

SCENE = {"miou": 0.5, "macc": 0.6, "pq": 0.4, "oracle_miou": 0.8, "oracle_pq": 0.7, "id_switches": 3}
FIGURES = {
    "psnr": 27.123,
    "per_view": {"miou": 0.71, "macc": 0.81},
    "scene": SCENE,
    "lidar": {"ap50": 0.66, "objects_per_instance": None},
    "click": {"hit_rate": 0.93, "collateral": 0.03},
    "n_instances": 1234,
}


def with_scene(miou):
    return {**FIGURES, "scene": {**SCENE, "miou": miou}}


def results(scores):
    """Outcomes of method cells by name, each with its scene mIoU."""
    outcomes = {}
    for cell in plan():
        if cell.name in scores:
            rows = {SPLIT: with_scene(scores[cell.name])}
            if cell.method in PUBLISHED_TOO:
                rows[PUBLISHED] = with_scene(scores[cell.name] - 0.2)
            outcomes[cell.name] = {"rows": rows, "commit": "abc1234", "date": "2030-01-02", "seconds": 60.0}
    return Results(outcomes, plan(), {})


def cells_of(text, title):
    """The first table row that starts with a title."""
    line = next(line for line in text.splitlines() if line.startswith(f"| {title} |"))
    return [part.strip() for part in line.strip("|").split("|")]


def test_numbers_for_readers():
    assert [format_value(each) for each in (None, 0.12345, 1234, "as is")] == ["–", "0.123", "1,234", "as is"]
    assert format_spread([0.1, 0.2, 0.3]) == "0.200 ± 0.100"
    assert format_spread([0.1, None]) == "0.100 (1 of 2)"
    assert format_spread([None]) == "–"
    assert ratio(1.0, 0.0) is ratio(None, 1.0) is None
    assert value(FIGURES, "scene.miou") == 0.5
    assert value(FIGURES, "scene.nothing.here") is None
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n|---|---:|\n| 1 | 2 |"
    assert oracle_key("lidar.ap") == "lidar.oracle_ap"


def test_an_empty_page_has_every_table_and_dashes_only():
    text = page(Results({}, plan(), {}))
    for title in ("Table 1", "PandaSet 002", "Ablations", "3D and selection", "Cost", "Figures"):
        assert f"## {title}" in text
    assert set(cells_of(text, "**ours**")[1:]) == {"–"}
    assert "**" not in cells_of(text, "LiDAR AP50")[2]


def test_headline_rows_and_both_rows_of_a_baseline():
    names = [f"street-{seed}/6/sam-v1/opengaussian" for seed in HEADLINE_SEEDS]
    text = page(results(dict(zip(names, (0.5, 0.6, 0.7), strict=True))))
    assert cells_of(text, "OpenGaussian, split")[1] == "0.600 ± 0.100"
    assert cells_of(text, "OpenGaussian, split")[-3:] == ["0.500", "0.600", "0.700"]
    assert cells_of(text, "OpenGaussian")[1] == "0.400 ± 0.100"
    assert "abc1234" in text
    assert "2030-01-02" in text


def test_a_missed_target_is_said_and_a_missing_figure_is_not_called_missed():
    place = {"seed 7": (STREET, "6", "sam-v1")}
    text = targets_table(
        results({f"{STREET}/6/sam-v1/instdrive": 0.75, f"{STREET}/6/sam-v1/opengaussian": 0.7}),
        place,
        {"OpenGaussian": "opengaussian", "mask graph": "mask-graph"},
    )
    assert cells_of(text, "scene mIoU ÷ oracle's")[2] == "0.938"
    assert cells_of(text, "PQ ÷ oracle's")[2] == "**0.571 missed**"
    assert cells_of(text, "collateral")[2] == "**0.0300 missed**"
    assert cells_of(text, "click hit rate")[2] == "0.930"
    assert cells_of(text, "objects per instance")[2] == "–"
    assert cells_of(text, "scene mIoU above OpenGaussian, split")[2] == "**0.050 missed**"
    assert cells_of(text, "scene mIoU above mask graph, split")[2] == "–"
    assert {target.text for target in TARGETS} >= {"LiDAR AP50", "residue", "instances per object"}


def test_the_voxel_sentence_tells_worse_from_better():
    full = {"lidar": {"ap": 0.5, "miou": 0.6, "instances_per_object": 1.2}}
    without = {"lidar": {"ap": 0.45, "miou": 0.65, "instances_per_object": 1.5}}
    text = voxel_sentence(full, without)
    worse, better = re.match(r".*get worse: (.*); better: (.*)\.", text).groups()
    assert worse == "AP -0.050, inst./object +0.300"
    assert better == "point mIoU +0.050"
    assert "get worse: none" in voxel_sentence(full, full)
    assert voxel_sentence({}, full).endswith("–")


def test_pandaset_lead_over_opengaussian_is_printed():
    text = page(results({f"{PANDASET}/6/lidar/instdrive": 0.62, f"{PANDASET}/6/lidar/opengaussian": 0.5}))
    assert "above OpenGaussian, split: 0.120" in text


def test_figures_are_shown_with_captions():
    name = f"figure/lidar/{STREET}"
    shown_page = page(Results({name: {"caption": "Points by ID.", "seconds": 1.0}}, plan(), {name: "images/a.jpg"}))
    assert "![Points by ID.](images/a.jpg)" in shown_page


def test_notes_by_hand_survive(tmp_path):
    file = tmp_path / "results.md"
    assert read_notes(file) == ""
    file.write_text(page(Results({}, plan(), {}), "Lamps are hard.\n\nSo are signs."))
    assert read_notes(file) == "Lamps are hard.\n\nSo are signs."
    assert page(Results({}, plan(), {}), read_notes(file)) == file.read_text()
    assert file.read_text().index(NOTES_START) < file.read_text().index(NOTES_END)


@pytest.mark.parametrize("scale", ["full", "miniature"])
def test_a_miniature_page_says_that_its_figures_mean_nothing(scale):
    text = page(Results({}, plan(), {}, scale))
    assert ("mean nothing" in text) == (scale == "miniature")
    json.dumps(text)
