"""docs/results.md from outcomes."""

import json
import re

import pytest

from benchmarks.cells import HEADLINE_SEEDS, PANDASET, PUBLISHED_TOO, STREET, plan
from benchmarks.outcomes import PUBLISHED, SPLIT, Results, format_spread, format_value, ratio, table, value
from benchmarks.results_page import (
    NOTES_END,
    NOTES_START,
    compare_voxel_sign,
    list_method_rows,
    page,
    reference_key,
    voxel_sentence,
)
from benchmarks.results_targets import TARGETS, find_stronger, targets_table
from benchmarks.tables import read_notes

SCENE = {"miou": 0.5, "macc": 0.6, "pq": 0.4, "reference_miou": 0.8, "reference_pq": 0.7, "id_switches": 3}
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
    assert reference_key("lidar.ap") == "lidar.reference_ap"


def test_an_empty_page_has_every_table_and_dashes_only():
    text = page(Results({}, plan(), {}))
    for title in ("Table 1", "PandaSet 002", "Ablations", "3D and selection", "Cost", "Figures"):
        assert f"## {title}" in text
    assert set(cells_of(text, "**ours**")[1:]) == {"–"}
    assert "**" not in cells_of(text, "LiDAR AP50")[2]


def test_headline_rows_and_both_rows_of_a_baseline():
    names = [f"street-{seed}/6/sam-v1/opengaussian" for seed in HEADLINE_SEEDS]
    text = page(results(dict(zip(names, (0.5, 0.7), strict=True))))
    assert cells_of(text, "OpenGaussian, split")[1] == "0.600 ± 0.141"
    assert cells_of(text, "OpenGaussian, split")[-2:] == ["0.500", "0.700"]
    assert cells_of(text, "OpenGaussian")[1] == "0.400 ± 0.141"
    assert "abc1234" in text
    assert "2030-01-02" in text


def test_a_missed_target_is_said_and_a_missing_figure_is_not_called_missed():
    place = {"seed 7": (STREET, "6", "sam-v1")}
    text = targets_table(
        results({f"{STREET}/6/sam-v1/instdrive": 0.75, f"{STREET}/6/sam-v1/opengaussian": 0.7}),
        place,
        {"OpenGaussian": "opengaussian", "mask graph": "mask-graph"},
    )
    assert cells_of(text, "scene mIoU ÷ reference's")[2] == "0.938"
    assert cells_of(text, "PQ ÷ reference's")[2] == "**0.571 missed**"
    assert cells_of(text, "collateral")[2] == "**0.0300 missed**"
    assert cells_of(text, "click hit rate")[2] == "0.930"
    assert cells_of(text, "objects per instance")[2] == "–"
    assert cells_of(text, "scene mIoU above OpenGaussian's stronger row")[2] == "**0.050 missed**"
    assert cells_of(text, "scene mIoU above mask graph's stronger row")[2] == "–"
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
    assert "above OpenGaussian's stronger row: 0.120" in text


def test_the_stronger_of_a_baselines_rows_leads():
    place = (STREET, "6", "sam-v1")
    made = results({f"{STREET}/6/sam-v1/opengaussian": 0.5, f"{STREET}/6/sam-v1/mask-graph": 0.5})
    made.outcomes[f"{STREET}/6/sam-v1/mask-graph"]["rows"][PUBLISHED] = with_scene(0.7)
    titles = [line[0] for line in list_method_rows(made, [place])]
    assert titles.index("OpenGaussian, split") < titles.index("OpenGaussian")
    assert titles.index("mask graph alone") < titles.index("mask graph alone, split")
    assert find_stronger(made, place, "mask-graph") == 0.7
    assert find_stronger(made, place, "paper") is None


def test_the_papers_own_length_has_rows_where_it_was_trained():
    name = f"street-{HEADLINE_SEEDS[0]}/6/sam-v1/paper+full"
    assert "own length |" not in page(results({}))
    assert cells_of(page(results({name: 0.5})), "InstDrive, own length, split")[-2:] == ["0.500", "–"]


def test_the_tuned_street_stays_out_of_the_headline():
    text = page(results({f"{STREET}/6/sam-v1/instdrive": 0.9, f"street-{HEADLINE_SEEDS[0]}/6/sam-v1/instdrive": 0.6}))
    headline, rest = text.split("## The street that settings were chosen on")
    assert cells_of(headline, "**ours**")[1] == "0.600 (1 of 2)"
    assert cells_of(rest, "**ours**")[1] == "0.900"


def test_the_sign_of_the_voxel_ablation_is_compared_with_the_papers():
    def codeword(miou):
        return {"codeword": {"per_view": {"miou": miou}}}

    assert "-0.035 here" in compare_voxel_sign(codeword(0.503), codeword(0.468))
    assert "the sign differs" in compare_voxel_sign(codeword(0.503), codeword(0.468))
    assert "the same sign" in compare_voxel_sign(codeword(0.5), codeword(0.51))


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
