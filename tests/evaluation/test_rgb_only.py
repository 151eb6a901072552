"""Clips of photos alone, from train to report: images are measured, nothing else is claimed, and it is said why."""

import json
from dataclasses import replace

import numpy as np
import pytest
from photo_models import photo_model, write_colmap_binary, write_nerfstudio

from instdrive_app.main import main
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.evaluation import comparison
from instdrive_core.evaluation.page.compare import write_comparison
from instdrive_core.evaluation.page.report import write_report
from instdrive_core.evaluation.protocol import evaluate_run
from instdrive_core.evaluation.tables import list_summary_rows
from instdrive_core.formats.folder.scenes import read_scene_folder, write_scene_folder
from instdrive_core.instances.table import build_instance_table
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, build_train_config

ABOUT_INSTANCES = ("codeword", "per_view", "scene", "lidar", "click")


@pytest.fixture(scope="module", params=[write_colmap_binary, write_nerfstudio], ids=["colmap", "nerfstudio"])
def run(request, tmp_path_factory):
    """A run of a few steps on a clip without LiDAR, cuboids and masks."""
    root = tmp_path_factory.mktemp("photos")
    clip = request.param(root / "clip", photo_model())
    config = build_train_config("instdrive", "demo", seed=1)
    geometry = replace(config.geometry, iterations=30, coarse_iterations=10, sky_resolution=8)
    init = InitConfig(lidar_points=400, near_points=100, far_points=100)
    request = RunRequest(clip, root / "run", ClipOptions(), replace(config, init=init, geometry=geometry))
    run_training(request, lambda event: None, lambda note: None)
    return root / "run"


def leaves(figures):
    for value in figures.values():
        yield from leaves(value) if isinstance(value, dict) else [value]


def test_eval_measures_images_and_says_why_nothing_else(run, capsys):
    assert main(["eval", str(run), "--json", str(run / "eval.json")]) == 0
    printed = capsys.readouterr().out
    assert "only images are measured" in printed
    assert "held-out time steps 4" in printed
    assert "PSNR (dB)" in printed
    for word in ("mIoU", "reference", "clicks", "moving objects", "random IDs"):
        assert word not in printed
    figures = json.loads((run / "eval.json").read_text())
    assert figures["ground_truth"] == "none"
    assert figures["psnr"] > 8
    assert 0 < figures["ssim"] < 1
    assert figures["psnr_actors"] is None
    assert {value for part in ABOUT_INSTANCES for value in leaves(figures[part])} == {None}


def test_the_page_has_no_empty_sections(run):
    evaluation = evaluate_run(run)
    write_report(run / "page.html", run, evaluation)
    page = (run / "page.html").read_text(encoding="utf-8")
    for there in ("RGB only", "Held-out views", "photo: ", "image: ", "Training", "PSNR (dB)", "SSIM"):
        assert there in page
    for empty in ("Predicted maps", "Objects", "Confusion", "LiDAR points", "ground truth: ", "instance map: ", "mIoU"):
        assert empty not in page
    assert page.count("<h2>") == 4
    assert "–" not in list_summary_rows(evaluation).values()


def test_the_rest_of_the_chain_works(run, tmp_path, capsys):
    assert main(["info", str(run)]) == 0
    printed = capsys.readouterr().out
    assert "5 photos" in printed
    assert "instances:    0" in printed
    runs = comparison.measure_runs([run, run], False, lambda stage, done, total: None)
    write_comparison(tmp_path / "compare.html", runs)
    page = (tmp_path / "compare.html").read_text(encoding="utf-8")
    assert "photo: " in page
    assert "instance map" not in page


def test_instances_of_unlabelled_photos_are_shown_but_not_measured(run, tmp_path):
    scene = read_scene_folder(run)
    scene.instance_ids[:] = 1 + (scene.gaussians.means[:, 0] > 0)
    scene.table = build_instance_table(scene.instance_ids, scene.gaussians.means)
    write_scene_folder(tmp_path, scene)
    (tmp_path / "run.json").write_bytes((run / "run.json").read_bytes())
    evaluation = evaluate_run(tmp_path)
    assert evaluation.figures["scene"]["miou"] is None
    assert evaluation.figures["n_instances"] == 2
    assert np.unique(evaluation.views[0].with_ids(scene.instance_ids).predicted).max() == 2
    write_report(tmp_path / "page.html", tmp_path, evaluation)
    assert "instance map: " in (tmp_path / "page.html").read_text(encoding="utf-8")
