"""Runs side by side: what is best, what is compared, where figures come from."""

import copy
import json
import os

import pytest
from evaluation_scene import DRIVING, PARKED, toy_drive
from report_page import FACTS, HOSTILE, ReadPage

from instdrive_app.main import main
from instdrive_core.evaluation import comparison, protocol
from instdrive_core.evaluation.comparison import MeasuredRun, compare_runs, find_differences, measure_runs
from instdrive_core.evaluation.page import compare as html_compare
from instdrive_core.evaluation.protocol import evaluate_scene
from instdrive_core.formats.folder.scenes import write_scene_folder

NO_PROGRESS = lambda stage, done, total: None  # noqa: E731


@pytest.fixture(scope="module")
def figures():
    drive = toy_drive()
    return evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS).figures


@pytest.fixture
def runs(tmp_path, monkeypatch, figures):
    """A good and a merged run of the toy drive, with figures written before; the clip is handed over in memory."""
    drive = toy_drive()
    for module in (protocol, html_compare):
        monkeypatch.setattr(module, "load_clip", lambda path, options: drive.clip)
        monkeypatch.setattr(module, "find_ground_truth", lambda clip: drive.truth)
    for name in ("good", "merged"):
        if name == "merged":
            drive.scene.instance_ids[drive.scene.instance_ids == DRIVING] = PARKED
        write_scene_folder(tmp_path / name, drive.scene)
        (tmp_path / name / "run.json").write_text(json.dumps(FACTS))
        worse = copy.deepcopy(figures)
        worse["scene"]["miou"] -= 0.25 * (name == "merged")
        (tmp_path / name / "eval.json").write_text(json.dumps(worse))
    return tmp_path


def measured(name: str, **values) -> MeasuredRun:
    nested: dict = {}
    for key, value in values.items():
        part, _, last = key.rpartition("__")
        (nested.setdefault(part, {}) if part else nested)[last] = value
    return MeasuredRun(name, nested, None)


def cells(key: str, runs: list[MeasuredRun]):
    return next(cells for figure, cells in compare_runs(runs) if figure.key == key)


def test_every_figure_that_is_known_is_compared(figures):
    def known(values, prefix=""):
        for key, value in values.items():
            if isinstance(value, dict):
                yield from known(value, f"{prefix}{key}.")
            elif isinstance(value, int | float) and key != "seed":
                yield prefix + key

    rows = {figure.key: figure for figure, _ in compare_runs([MeasuredRun("a", figures, None)])}
    assert set(rows) == set(known(figures))
    assert rows["scene.reference_pq"].better == "higher"
    assert rows["scene.reference_pq"].title == "reference: PQ"


def test_figures_without_a_row_of_their_own_are_shown_without_a_best():
    [(figure, row)] = compare_runs([measured("a", scene__novel=0.5), measured("b", scene__novel=0.75)])
    assert (figure.key, figure.title) == ("scene.novel", "scene.novel")
    assert [(cell.text, cell.delta, cell.best) for cell in row] == [("0.500", "", False), ("0.750", "+0.250", False)]


def test_the_best_is_the_highest_or_the_lowest():
    first = measured("a", psnr=30.0, train_seconds=100.0, n_gaussians=5, scene__pq=None)
    second = measured("b", psnr=31.5, train_seconds=90.0, n_gaussians=9, scene__pq=0.5)
    third = measured("c", psnr=31.499, train_seconds=400.0, n_gaussians=7, scene__pq=0.4)
    runs = [first, second, third]
    assert [cell.best for cell in cells("psnr", runs)] == [False, True, True], "equal as written"
    assert [cell.best for cell in cells("train_seconds", runs)] == [False, True, False]
    assert not any(cell.best for cell in cells("n_gaussians", runs))
    assert [cell.best for cell in cells("scene.pq", runs)] == [False, True, False]
    assert [cell.delta for cell in cells("psnr", runs)] == ["", "+1.50", "+1.50"]
    assert [cell.delta for cell in cells("scene.pq", runs)] == ["", "", ""]
    assert cells("scene.pq", runs)[0].text == "–"
    assert "ssim" not in {figure.key for figure, _ in compare_runs(runs)}


def test_nothing_is_best_alone_or_where_all_are_equal():
    assert not any(cell.best for cell in cells("psnr", [measured("a", psnr=30.0), measured("b", psnr=30.001)]))
    assert not any(cell.best for _, row in compare_runs([measured("a", psnr=30.0)]) for cell in row)
    assert not any(cell.best for cell in cells("psnr", [measured("a", psnr=30.0), measured("b", psnr=None)]))


def test_values_that_are_no_numbers_are_unknown():
    run = MeasuredRun("a", {"psnr": "30", "ssim": True, "scene": [1]}, None)
    assert run.value("psnr") is run.value("ssim") is run.value("scene.miou") is None


def test_files_of_earlier_versions_name_the_reference_otherwise(runs, figures):
    file, renamed = runs / "good" / "eval.json", json.dumps(figures).replace('"reference_', '"oracle_')
    file.write_text(renamed)
    assert "oracle_" in renamed
    [run] = measure_runs([file], False, NO_PROGRESS)
    assert run.figures == figures


def test_other_photos_are_pointed_out():
    first, second = measured("a", clip="x", cameras="6"), measured("b", clip="y", cameras="6")
    assert find_differences([first, first]) == []
    assert find_differences([first, second]) == ["clip differ (x, y): the runs are measured on different photos"]


def test_command_marks_the_best(runs, capsys):
    assert main(["compare", str(runs / "good"), str(runs / "merged" / "eval.json")]) == 0
    printed = capsys.readouterr().out
    line = next(line for line in printed.splitlines() if "scene mIoU " in line)
    assert line.index("★") < line.index("-0.250")
    assert "good" in printed
    assert "merged" in printed


def test_page_shows_the_same_views_of_each_run(runs, capsys):
    log = json.dumps({"stage": "rgb", "seconds": 1.0, "loss": 0.5, "psnr": 20.0, "gaussians": 3, "terms": {}})
    for name in ("good", "merged"):
        (runs / name / "log.jsonl").write_text(f"{log}\n{log.replace('1.0', '2.0')}\n")
    out = runs / "page.html"
    assert main(["compare", str(runs / "good"), str(runs / "merged"), "--html", str(out)]) == 0
    page = ReadPage(out.read_text())
    for start in ("photo: ", "good: ", "merged: ", "good, instance map", "merged, instance map"):
        assert len(page.pictures(start)) == 2 * (1 + ("map" in start)), start
    assert page.tags.count("svg") == 3
    assert 'class="number best"' in out.read_text()
    assert (page.pictures("good, instance")[0] != page.pictures("merged, instance")[0]).any()


def test_eval_writes_its_report_where_it_is_told_to(runs, capsys):
    good, report = runs / "good", runs / "good" / "report.html"
    assert main(["eval", str(good), "--no-html"]) == 0
    assert not report.exists()
    assert main(["eval", str(good), "--html", str(runs / "there.html")]) == 0
    assert not report.exists()
    assert "good: evaluation" in ReadPage((runs / "there.html").read_text()).text
    assert main(["eval", str(good)]) == 0
    assert report.exists()
    assert "there.html" in capsys.readouterr().out


def test_stale_figures_are_measured_again(runs, figures):
    [old] = comparison.measure_runs([runs / "merged"], False, NO_PROGRESS)
    assert old.figures["scene"]["miou"] == figures["scene"]["miou"] - 0.25
    os.utime(runs / "merged" / "eval.json", (1, 1))
    [new] = comparison.measure_runs([runs / "merged"], False, NO_PROGRESS)
    assert new.figures["scene"]["miou"] != old.figures["scene"]["miou"]
    assert json.loads((runs / "merged" / "eval.json").read_text()) == new.figures
    assert comparison.measure_runs([runs / "merged"], False, NO_PROGRESS) == [new]


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("absent", None, "no such run or file"),
        ("broken.json", "{", "not valid JSON"),
        ("other.json", '{"psnr": 3}', "'per_view' is missing"),
        ("list.json", "[]", "'psnr' is missing"),
    ],
)
def test_what_is_no_run(tmp_path, capsys, name, content, problem):
    if content is not None:
        (tmp_path / name).write_text(content)
    assert main(["compare", str(tmp_path / name)]) == 2
    assert problem in capsys.readouterr().err


def test_a_folder_that_is_no_run_and_no_folder_at_all(tmp_path, capsys):
    assert main(["compare", str(tmp_path)]) == 2
    assert "no finished run" in capsys.readouterr().err
    assert main(["compare"]) == 2


def test_names_tell_runs_apart(tmp_path, figures):
    for name in ("x/run", "y/run"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "eval.json").write_text(json.dumps(figures))
    paths = [tmp_path / "x/run/eval.json", tmp_path / "y/run/eval.json"]
    assert [run.name for run in comparison.measure_runs(paths, False, NO_PROGRESS)] == ["x/run", "y/run"]
    twice = comparison.measure_runs([paths[0], paths[0]], False, NO_PROGRESS)
    assert len(twice) == 2


def test_a_hostile_name_and_hostile_figures(tmp_path, figures):
    path = tmp_path / "a<b>&[red].json"
    path.write_text(json.dumps(figures | {"clip": HOSTILE, "backend": HOSTILE}))
    assert main(["compare", str(path), "--html", str(tmp_path / "page.html")]) == 0
    page = ReadPage((tmp_path / "page.html").read_text())
    assert page.tags.count("script") == 1
    assert page.text.count(HOSTILE) == 2
    assert "a<b>&[red]" in page.text


def test_a_run_whose_clip_is_gone_keeps_its_figures(runs, monkeypatch, capsys):
    def gone(path, options):
        raise comparison.DataError(path, "there is no clip", "Put it back.")

    monkeypatch.setattr(html_compare, "load_clip", gone)
    assert main(["compare", str(runs / "good"), "--html", str(runs / "page.html")]) == 0
    page = ReadPage((runs / "page.html").read_text())
    assert "No views of good" in page.text
    assert "scene mIoU" in page.text


def test_the_table_is_written_for_other_programs(runs):
    paths = [str(runs / name) for name in ("good", "merged")]
    assert main(["compare", *paths, "--json", str(runs / "table.json")]) == 0
    table = json.loads((runs / "table.json").read_text())
    assert (table["names"], table["notes"]) == (["good", "merged"], [])
    good, merged = next(row["cells"] for row in table["rows"] if row["title"] == "scene mIoU")
    assert (good["best"], merged["best"]) == (True, False)
    assert merged["delta"] == "-0.250"
