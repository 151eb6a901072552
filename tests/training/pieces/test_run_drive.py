"""A drive trained in two pieces: the run folder, going on after a kill, and what cannot be cut."""

import json
from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import OptionError
from instdrive_core.evaluation.protocol import evaluate_run
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.instances.codebook import quantize_features
from instdrive_core.training.pieces.drive import FOLDER, run_drive
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, TrainConfig, build_train_config
from instdrive_core.training.settings.events import CheckpointDue

STEPS = 8


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """Eight steps of a small street, of which step 4 is held out."""
    clip = tmp_path_factory.mktemp("street") / "clip"
    write_street(clip, StreetConfig(seed=3, steps=STEPS, width=96, height=54, lidar_azimuths=300))
    return clip


def short(method="instdrive") -> TrainConfig:
    config = build_train_config(method, "demo", seed=1)
    return replace(
        config,
        init=InitConfig(lidar_points=2_000, near_points=200, far_points=200, actor_points=100),
        geometry=replace(config.geometry, iterations=8, coarse_iterations=2, sky_resolution=8),
        checkpoint_every=4,
    )


def train(clip, out, notes=None, on_event=lambda event: None, **request):
    values = {"options": ClipOptions(cameras="1"), "config": short(), "pieces": 2, **request}
    return run_drive(RunRequest(clip, out, **values), on_event, (notes if notes is not None else []).append)


@pytest.fixture(scope="module")
def trained(street, tmp_path_factory):
    """A run of two pieces that went through."""
    return train(street, tmp_path_factory.mktemp("trained") / "run")


class Killed(Exception):
    """Stands for a killed process."""


def test_a_joined_run_looks_like_any_other(street, trained):
    scene, facts = read_scene_folder(trained), json.loads((trained / "run.json").read_text())
    clip = load_clip(str(street), ClipOptions(cameras="1"))
    assert [view.index for view in scene.views] == list(range(STEPS))
    np.testing.assert_array_equal(scene.origin, clip.origin)
    assert facts["n_gaussians"] == len(scene) > 0
    assert facts["n_instances"] == len(scene.table) > 0
    assert facts["iterations"] == 16
    assert (facts["first_frame"], facts["last_frame"]) == (None, None)
    assert [piece["core_first"] for piece in facts["pieces"]] == [0, 4]
    np.testing.assert_array_equal(scene.codewords, quantize_features(scene.gaussians.features))
    pairs = np.unique(np.stack([scene.instance_ids, scene.codewords]), axis=1)
    assert pairs.shape[1] == len(scene.table) == len(np.unique(scene.codewords))
    assert sorted(scene.exposures.keys) == sorted(frame.key for frame in clip.training_frames)
    seconds = [json.loads(line)["seconds"] for line in (trained / "log.jsonl").read_text().splitlines()]
    assert seconds == sorted(seconds)


def test_nothing_is_in_the_scene_twice(trained):
    joined = read_scene_folder(trained)
    parts = [read_scene_folder(trained / FOLDER / f"{number:02d}") for number in range(2)]
    assert 0 < len(joined) < sum(map(len, parts))
    tracks = [actor.id for actor in joined.actors]
    assert len(tracks) == len(set(tracks))
    assert set(tracks) == {actor.id for part in parts for actor in part.actors}
    for node in range(1, len(tracks) + 1):
        assert len(np.unique(joined.instance_ids[joined.nodes == node])) <= 1


def test_a_joined_run_is_measured_with_the_whole_drive(trained):
    evaluation = evaluate_run(trained)
    assert evaluation.held_out_steps == (4,)
    assert evaluation.figures["scene"]["id_switches"] is not None


@pytest.mark.parametrize("piece", [0, 1])
def test_a_killed_run_goes_on_where_it_stood(street, trained, tmp_path, piece):
    seen = []

    def kill(event):
        if isinstance(event, CheckpointDue):
            seen.append(event)
        if len(seen) == 1 + 2 * piece:
            raise Killed

    with pytest.raises(Killed):
        train(street, tmp_path / "run", on_event=kill)
    notes, again = [], []
    train(street, tmp_path / "run", notes, lambda event: again.append(isinstance(event, CheckpointDue)), resume=True)
    assert sum(again) == 3 - 2 * piece, "what was done is not done again"
    assert ("piece 1 of 2 is finished" in notes) == (piece == 1)
    whole, part = read_scene_folder(trained), read_scene_folder(tmp_path / "run")
    np.testing.assert_array_equal(part.instance_ids, whole.instance_ids)
    np.testing.assert_array_equal(part.gaussians.means, whole.gaussians.means)


def test_a_run_resumes_with_its_own_options_only(street, trained):
    with pytest.raises(OptionError, match="--pieces is 3"):
        train(street, trained, resume=True, pieces=3)
    with pytest.raises(OptionError, match="other options"):
        train(street, trained, resume=True, config=replace(short(), seed=2))
    with pytest.raises(OptionError, match="already holds a run"):
        train(street, trained)


def test_a_short_drive_is_one_ordinary_run(street, tmp_path):
    train(street, tmp_path / "auto", pieces="auto")
    request = RunRequest(street, tmp_path / "plain", ClipOptions(cameras="1"), short())
    run_training(request, lambda event: None, lambda note: None)
    assert not (tmp_path / "auto" / FOLDER).exists()
    scenes = [next((tmp_path / name).glob("scene.*.safetensors")) for name in ("auto", "plain")]
    assert scenes[0].name == scenes[1].name, "the name is made of the arrays' digest"
    facts = [(tmp_path / name / "run.json").read_text().replace(f"/{name}/", "/run/") for name in ("auto", "plain")]
    assert json.loads(facts[0])["notes"] == json.loads(facts[1])["notes"]


@pytest.mark.parametrize("method", ["paper", "mask-graph"])
def test_other_methods_say_that_they_cannot_be_cut(street, tmp_path, method):
    with pytest.raises(OptionError, match=f"method '{method}' learns codewords"):
        train(street, tmp_path / "run", config=short(method), learner=lambda *args: None)


def test_a_scene_to_start_from_is_not_cut(street, trained, tmp_path):
    with pytest.raises(OptionError, match="--init starts from one scene"):
        train(street, tmp_path / "run", init=trained)


@pytest.mark.parametrize(
    ("method", "told"), [("instdrive", "3 pieces of"), ("paper", "in one piece: method 'paper'")], ids=["cut", "whole"]
)
def test_auto_tells_what_it_does_with_a_drive_too_long_for_one_run(street, tmp_path, monkeypatch, method, told):
    def stop(note):
        if told in note:
            raise Killed

    monkeypatch.setattr("instdrive_core.training.pieces.drive.count_affordable_photos", lambda clip, gaussians: 3)
    monkeypatch.setattr("instdrive_core.training.pieces.plan.LEAST_METRES", 0.5)
    options = ClipOptions(cameras="1")
    with pytest.raises(Killed):
        run_drive(RunRequest(street, tmp_path / "run", options, short(method), pieces="auto"), lambda event: None, stop)
