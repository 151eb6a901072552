"""The demo's main job on a smaller street: clip, masks, training, evaluation, scripted session, and its pictures."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData
from rich.console import Console

from instdrive_app.cli.demo import prepare_run
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.training.settings.config import InitConfig, build_train_config


@pytest.fixture(scope="module")
def demo_folder(tmp_path_factory):
    """Five small steps, of which step 4 is held out."""
    out = tmp_path_factory.mktemp("demo")
    config = build_train_config("instdrive", "demo")
    config = replace(
        config,
        init=InitConfig(lidar_points=20_000, near_points=2_000, far_points=2_000, actor_points=500),
        geometry=replace(config.geometry, iterations=150, coarse_iterations=50, sky_resolution=32),
        instances=replace(config.instances, iterations=250),
    )
    prepare_run(out, StreetConfig(seed=7, steps=5, width=160, height=90), config, Console(quiet=True))
    return out


def test_evaluation_finds_objects_that_no_control_would(demo_folder):
    figures = json.loads((demo_folder / "eval.json").read_text())
    assert figures["psnr"] > 20
    assert figures["scene"]["miou"] > 0.5
    assert figures["scene"]["miou"] > 0.8 * figures["scene"]["reference_miou"]
    assert figures["click"]["hit_rate"] > 0.5
    assert figures["lidar"]["ap50"] > 0.3
    assert figures["masks"] == "exact"


def test_the_run_is_a_scene_with_named_instances_and_views(demo_folder):
    scene = read_scene_folder(demo_folder / "run")
    assert len(scene.views) == 30
    assert sum(view.held_out for view in scene.views) == 6
    assert len(scene.table) >= 20
    assert any(instance.class_name == "Car" for instance in scene.table)
    assert all(np.isfinite(array).all() for array in scene.gaussians.arrays().values())


def test_a_second_demo_uses_what_is_there(demo_folder):
    before = (demo_folder / "run" / "run.json").stat().st_mtime_ns
    console = Console(record=True, quiet=True)
    prepare_run(demo_folder, StreetConfig(seed=7), build_train_config("instdrive", "demo"), console)
    assert (demo_folder / "run" / "run.json").stat().st_mtime_ns == before


@pytest.mark.slow
@pytest.mark.gui
def test_the_scripted_session_shows_what_it_did(demo_folder):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    code = "import sys; from pathlib import Path; from instdrive_app.cli.demo import play; "
    code += "play(Path(sys.argv[1]) / 'run', Path(sys.argv[1]))"
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    subprocess.run([sys.executable, "-c", code, str(demo_folder)], env=environment, check=True, timeout=500)

    scene = read_scene_folder(demo_folder / "run")
    session = json.loads((demo_folder / "session.json").read_text())
    pictures = {name: np.asarray(Image.open(demo_folder / name)) for name in session["pictures"]}
    shown = set(np.unique(ids_from_colors(pictures["id_map.png"])).tolist()) - {0}
    assert len(shown) >= 10
    assert shown <= set(scene.table.instances)

    clicked = ids_from_colors(pictures["id_map.png"]) == session["picked_id"]
    before, deleted, tinted = (pictures[f"{name}.png"][clicked].astype(int) for name in ("color", "deleted", "tinted"))
    changed = np.abs(before - deleted).max(axis=1) > 8
    assert changed.mean() > 0.5
    assert (np.abs(before - tinted).max(axis=1) > 8).mean() > 0.5
    recolored = ids_from_colors(pictures["id_map.png"]) == session["recolored_id"]
    difference = np.abs(pictures["recolored.png"][recolored].astype(int) - pictures["color.png"][recolored])
    assert (difference.max(axis=1) > 8).mean() > 0.5

    # The window still shows the scene after the session drew pictures of other sizes.
    viewport = [pictures[f"{name}.png"][60:480, 10:920].mean(axis=2).ravel() for name in ("hover", "editor")]
    assert np.corrcoef(*viewport)[0, 1] > 0.8

    exported = PlyData.read(demo_folder / "edited.ply")["vertex"]["instance_id"]
    assert session["picked_id"] not in exported
    assert session["recolored_id"] in exported
