"""The report's page: it parses, its pictures decode, its text cannot break out, and it shows what was measured."""

import dataclasses
import json

import numpy as np
import pytest
from evaluation_scene import DRIVING, PARKED, ToyDrive
from report_page import FACTS, HOSTILE, ReadPage, decode_picture, log_line

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.evaluation.page import report as html_report
from instdrive_core.evaluation.page.report import write_report
from instdrive_core.evaluation.page.views import spread_over_steps
from instdrive_core.evaluation.protocol import evaluate_scene
from instdrive_core.instances.colormap import ids_from_colors


@pytest.fixture
def report(drive: ToyDrive, tmp_path):
    """Writes the page of the toy drive with the given facts and log, and reads it."""

    def write(log: str = "", **facts) -> ReadPage:
        (tmp_path / "run.json").write_text(json.dumps(FACTS | facts))
        (tmp_path / "log.jsonl").write_text(log)
        evaluation = evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS | facts)
        write_report(tmp_path / "report.html", tmp_path, evaluation)
        text = (tmp_path / "report.html").read_text(encoding="utf-8")
        assert "http" not in text.replace("http-equiv", ""), "nothing is fetched"
        return ReadPage(text)

    return write


def test_views_are_shown_as_they_are(drive, report):
    page = report()
    views = drive.clip.held_out_frames
    assert all(decode_picture(image["src"]).size for image in page.images)
    for start in ("photo: ", "image: ", "errors: "):
        assert len(page.pictures(start)) == len(views)
    for photo, frame in zip(page.pictures("photo: "), views, strict=True):
        assert np.abs(photo.astype(float) - frame.load_image()).mean() < 4
    truth, predicted = page.pictures("ground truth: ")[::2], page.pictures("instance map: ")[::2]
    for shown, other, frame in zip(truth, predicted, views, strict=True):
        labels = drive.truth.load(frame)
        counted = ids_from_colors(shown) > 0
        np.testing.assert_array_equal(ids_from_colors(shown)[counted], labels[counted])
        same = (shown == other).all(axis=2)[counted].mean()
        assert same > 0.8, "objects and their instances share colours"


def test_merged_objects_are_named_and_marked(drive, report):
    scene = drive.scene
    scene.instance_ids[scene.instance_ids == DRIVING] = PARKED
    page = report()
    orange = np.array([213, 94, 0])
    wrong = [(errors == orange).all(axis=2).mean() for errors in page.pictures("errors: ")]
    assert max(wrong) > 0.02
    shared = page.text.split("Objects that share an instance")[1].split("Objects in several instances")[0]
    assert "parked" in shared
    assert "driving" in shared
    unmatched = page.text.split("Filter")[-1] or page.text
    assert "none" in unmatched


def test_names_from_files_cannot_break_out(drive, report):
    drive.truth.instances = {
        number: dataclasses.replace(instance, name=HOSTILE, class_name=HOSTILE)
        for number, instance in drive.truth.instances.items()
    }
    for instance in list(drive.scene.table):
        drive.scene.table.set(dataclasses.replace(instance, name=HOSTILE + "\x00\ud800"))
    log = "\n".join(log_line("rgb", step, terms={HOSTILE: 0.5}) for step in range(5))
    log += "\n" + "\n".join(log_line(HOSTILE, step) for step in range(5))
    page = report(log, clip=HOSTILE, cameras=HOSTILE, backend=HOSTILE, method=HOSTILE)
    assert page.tags.count("script") == 1, "the page's own"
    assert page.text.count(HOSTILE) > 12
    assert all(image["src"].startswith("data:image/") for image in page.images)


def test_training_is_drawn_from_the_log(report):
    lines = [log_line("rgb", step) for step in range(1, 20)] + [log_line("instances", step) for step in range(20, 40)]
    page = report("\n".join(lines) + '\n{"stage": "rgb", "iter')
    assert page.tags.count("svg") == 4
    for name in ("PSNR of training images (dB)", "colour stage", "instance stage", "pull"):
        assert name in page.text


@pytest.mark.parametrize("log", ["", "{}\n[]\nnull\n7\n"])
def test_a_log_that_tells_nothing(report, log):
    page = report(log)
    assert "svg" not in page.tags
    assert "kept no log" in page.text


def test_a_scene_without_instances(drive, report):
    drive.scene.instance_ids[:] = 0
    drive.scene.table.instances.clear()
    drive.scene.code_bits = 0
    page = report()
    assert "This scene has no instances" in page.text
    assert page.pictures("photo: ")


def test_a_page_keeps_within_its_budget(drive, report, monkeypatch):
    monkeypatch.setattr(html_report, "PICTURE_BUDGET", 20_000)
    page = report()
    shown = len(page.pictures("photo: "))
    assert 0 < shown < len(drive.clip.held_out_frames)
    assert f"{4 - shown} further views are left out" in page.text


def test_any_beginning_covers_the_steps():
    steps = [4, 4, 14, 14, 24, 24, 34, 34]
    order = [steps[number] for number in spread_over_steps(steps)]
    assert order == [4, 4, 24, 24, 14, 14, 34, 34]


def test_a_report_that_cannot_be_written(drive: ToyDrive, tmp_path):
    (tmp_path / "run.json").write_text(json.dumps(FACTS))
    evaluation = evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS)
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        write_report(tmp_path / "file" / "report.html", tmp_path, evaluation)


def test_privileged_runs_say_so(drive, report):
    drive.truth.source = "annotations"
    assert "Privileged" in report(masks="annotations").text
    assert "Privileged" not in report().text


def test_the_toy_clip_is_what_the_tests_assume(drive):
    assert isinstance(drive.clip, Clip)
    assert len(drive.clip.held_out_frames) == 4
