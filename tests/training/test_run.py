"""Run folders: what a training leaves, resuming it, and refusing what cannot be trained."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import load_file
from written_street import SMALL, copy_street

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.formats.ply.inria import write_ply
from instdrive_core.instances.codebook import quantize_features
from instdrive_core.masks.making import make_masks
from instdrive_core.training.build_trainer import add_first_features
from instdrive_core.training.gaussians import first_gaussians
from instdrive_core.training.run import CHECKPOINT, RunRequest, run_training
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import InitConfig, TrainConfig, build_train_config, keep_geometry
from instdrive_core.training.settings.events import CheckpointDue, DensifyDone


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """Five steps of a small street, of which step 4 is held out; without masks of its own."""
    return copy_street(SMALL, tmp_path_factory.mktemp("street") / "clip", tmp_path_factory)


@pytest.fixture(scope="module")
def masked(street, tmp_path_factory):
    """A copy of the street with masks, which each run would else draw for itself: that takes longer than training."""
    clip = tmp_path_factory.mktemp("masked") / "clip"
    shutil.copytree(street, clip)
    make_masks(load_clip(str(clip), ClipOptions(cameras="1")), "annotations", clip / "masks")
    return clip


def short(method="instdrive") -> TrainConfig:
    config = build_train_config(method, "demo", seed=1)
    return replace(
        config,
        init=InitConfig(lidar_points=3_000, near_points=200, far_points=200, actor_points=100),
        geometry=replace(config.geometry, iterations=16, coarse_iterations=4, sky_resolution=8),
        instances=replace(config.instances, learned_by="losses", iterations=16, pixels_per_view=500, feature_dim=8),
        checkpoint_every=8,
    )


def train(clip, out, notes=None, on_event=lambda event: None, **request):
    values = {"options": ClipOptions(cameras="1"), "config": short(), **request}
    return run_training(RunRequest(clip, out, **values), on_event, (notes if notes is not None else []).append)


class Interrupted(Exception):
    """Stands for a killed process."""


def test_a_run_holds_scene_log_facts_and_its_masks(street, tmp_path):
    notes = []
    run = train(street, tmp_path / "run", notes)
    scene, facts = read_scene_folder(run), json.loads((run / "run.json").read_text())
    assert facts["n_gaussians"] == len(scene)
    assert facts["masks"] == "annotations"
    assert (run / "masks" / "masks.json").is_file()
    assert facts["n_instances"] == len(scene.table) > 0
    assert scene.code_bits == 8
    assert set(np.unique(scene.instance_ids)) - {0} == {instance.id for instance in scene.table}
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert {line["stage"] for line in lines} == {"rgb", "instances"}
    assert any("annotations" in note for note in notes)


@pytest.mark.parametrize("stage", ["rgb", "instances"])
def test_an_interrupted_run_resumes_to_the_same_bits(masked, tmp_path, stage):
    def stop(event):
        if isinstance(event, CheckpointDue) and event.stage == stage:
            raise Interrupted

    train(masked, tmp_path / "whole")
    with pytest.raises(Interrupted):
        train(masked, tmp_path / "part", on_event=stop)
    train(masked, tmp_path / "part", resume=True)
    whole, part = (load_file(tmp_path / name / CHECKPOINT) for name in ("whole", "part"))
    assert whole.keys() == part.keys()
    for name, array in whole.items():
        np.testing.assert_array_equal(part[name], array, err_msg=name)


def by_votes() -> TrainConfig:
    """Instances without training, as `--method instdrive` does."""
    config = short()
    return replace(config, instances=replace(config.instances, learned_by="votes"))


def test_votes_name_instances_without_training(masked, tmp_path):
    notes = []
    run = train(masked, tmp_path / "run", notes, config=by_votes())
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert {line["stage"] for line in lines} == {"rgb"}
    assert any("objects" in note for note in notes)
    scene = read_scene_folder(run)
    assert (scene.instance_ids > 0).all()
    np.testing.assert_array_equal(scene.codewords, quantize_features(scene.gaussians.features))
    pairs = np.unique(np.stack([scene.instance_ids, scene.codewords]), axis=1)
    assert pairs.shape[1] == len(scene.table) == len(np.unique(scene.codewords))
    for node in range(1, len(scene.actors) + 1):
        assert len(np.unique(scene.instance_ids[scene.nodes == node])) <= 1


@pytest.mark.parametrize("edge_start", [0.75, 0.4], ids=["before edges are learned", "while they are"])
def test_votes_are_the_same_after_an_interruption(masked, tmp_path, edge_start):
    config = by_votes()
    config = replace(
        config,
        geometry=replace(config.geometry, edge_start=edge_start),
        densify=replace(config.densify, stop=0.2),
    )

    def stop(event):
        if isinstance(event, CheckpointDue):
            raise Interrupted

    whole = read_scene_folder(train(masked, tmp_path / "whole", config=config))
    with pytest.raises(Interrupted):
        train(masked, tmp_path / "part", config=config, on_event=stop)
    named = any(name.startswith("named.") for name in load_file(tmp_path / "part" / CHECKPOINT))
    assert named == (edge_start < 0.5)  # the run is stopped half-way
    part = read_scene_folder(train(masked, tmp_path / "part", config=config, resume=True))
    np.testing.assert_array_equal(part.instance_ids, whole.instance_ids)
    np.testing.assert_array_equal(part.gaussians.log_scales, whole.gaussians.log_scales)


def test_votes_leave_a_scene_trained_elsewhere_as_it_is(masked, trained, tmp_path):
    run = train(masked, tmp_path / "run", config=keep_geometry(by_votes()), init=trained)
    before, after = read_scene_folder(trained), read_scene_folder(run)
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(getattr(after.gaussians, name), getattr(before.gaussians, name), err_msg=name)
    assert len(after.table) > 1


def test_a_folder_with_a_run_is_not_overwritten(masked, tmp_path):
    train(masked, tmp_path / "run")
    with pytest.raises(OptionError, match="already holds a run"):
        train(masked, tmp_path / "run")
    with pytest.raises(OptionError, match="other options"):
        train(masked, tmp_path / "run", config=replace(short(), seed=9), resume=True)
    with pytest.raises(OptionError, match="no run to resume"):
        train(masked, tmp_path / "elsewhere", resume=True)


def test_a_damaged_checkpoint_is_named(masked, tmp_path):
    run = train(masked, tmp_path / "run")
    (run / CHECKPOINT).write_bytes((run / CHECKPOINT).read_bytes()[:1000])
    with pytest.raises(DataError, match=CHECKPOINT):
        train(masked, tmp_path / "run", resume=True)


def test_without_masks_or_annotations_colour_is_trained_and_said(street, tmp_path):
    bare, notes = tmp_path / "bare", []
    shutil.copytree(street, bare, ignore=shutil.ignore_patterns("annotations", "labels"))
    scene = read_scene_folder(train(bare, tmp_path / "run", notes))
    assert any("no masks" in note for note in notes)
    assert len(scene.table) == 0
    assert not scene.instance_ids.any()
    assert scene.actors == ()


def test_frames_of_held_out_steps_alone_cannot_train(street, tmp_path):
    with pytest.raises(DataError, match="no photo of a training time step"):
        train(street, tmp_path / "run", options=ClipOptions(cameras="1", first_frame=4, last_frame=4))


def test_the_paper_method_trains_jointly(masked, tmp_path):
    config = short("paper")
    run = train(masked, tmp_path / "run", config=config)
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert {line["stage"] for line in lines} == {"rgb"}
    assert {"pull", "push", "rgb"} <= set(lines[-1]["terms"])
    assert json.loads((run / "run.json").read_text())["method"] == "paper"


@pytest.fixture(scope="module")
def trained(masked, tmp_path_factory):
    """A run to start others from."""
    return train(masked, tmp_path_factory.mktemp("trained") / "run", config=with_growth(short()))


def with_growth(config: TrainConfig) -> TrainConfig:
    """Configuration whose Gaussians grow within the few steps there are."""
    return replace(config, densify=replace(config.densify, start=4, every=5, stop=0.9, gradient_threshold=1e-6))


def test_gaussians_grow_up_to_the_cap(masked, tmp_path):
    config = with_growth(short())
    config = replace(config, densify=replace(config.densify, max_gaussians=9_500))
    events = []
    run = train(masked, tmp_path / "run", config=config, on_event=events.append)
    grown = [event for event in events if isinstance(event, DensifyDone)]
    assert grown[0].cloned + grown[0].split > 0
    assert max(event.gaussians for event in grown) == 9_500
    left = json.loads((run / "run.json").read_text())["n_gaussians"]
    assert 0.95 * grown[-1].gaussians < left <= grown[-1].gaussians  # without what nobody can see
    assert left == len(read_scene_folder(run))


@pytest.mark.parametrize("form", ["run", "ply"])
@pytest.mark.parametrize("method", ["instdrive", "paper"])
def test_instances_are_learned_on_a_scene_trained_elsewhere(masked, trained, tmp_path, form, method):
    """Its geometry and colours stay as they are, whichever origin they are stored with; a .ply brings no actors."""
    before, start = read_scene_folder(trained), trained
    if form == "ply":
        before = freeze_at_time(before, 0.0)
        before.gaussians.means += np.float32(5)
        before.origin = before.origin - 5
        start = tmp_path / "elsewhere.ply"
        write_ply(start, before)
    config = keep_geometry(short(method))
    run = train(masked, tmp_path / "run", config=config, init=start)
    after = read_scene_folder(run)
    assert len(after) == len(before)
    shift = (before.origin - after.origin)[None] * (before.nodes == 0)[:, None]
    np.testing.assert_allclose(after.gaussians.means, before.gaussians.means + shift, atol=1e-4)
    for name in ("quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(getattr(after.gaussians, name), getattr(before.gaussians, name), err_msg=name)
    assert len(after.actors) == len(before.actors)
    assert bool(before.actors) == (form == "run")
    first = add_first_features(before.gaussians, config).features
    assert np.abs(after.gaussians.features - first).max() > 0.01
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert {line["stage"] for line in lines} == {"instances"}
    assert lines[-1]["iteration"] == 16


def test_colours_are_trained_on_from_another_scene(masked, trained, tmp_path):
    run = train(masked, tmp_path / "run", init=trained)
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    first = next(json.loads(line) for line in (trained / "log.jsonl").read_text().splitlines())
    assert lines[0]["stage"] == "rgb"
    assert lines[0]["loss"] < first["loss"]
    assert json.loads((run / "run.json").read_text())["init"] == str(trained)


def test_a_scene_from_somewhere_else_is_refused(masked, trained, tmp_path):
    scene = freeze_at_time(read_scene_folder(trained), 0.0)
    scene.gaussians.means += np.float32(10_000)
    write_ply(tmp_path / "far.ply", scene)
    with pytest.raises(DataError, match=r"far.ply.*before a camera.*world coordinates"):
        train(masked, tmp_path / "run", config=keep_geometry(short()), init=tmp_path / "far.ply")
    with pytest.raises(OptionError, match="--init"):
        train(masked, tmp_path / "other", config=keep_geometry(short()))


def test_a_static_run_has_no_actors_and_says_so(street, tmp_path):
    config, notes = short(), []
    config = replace(config, init=replace(config.init, moving_actors=False))
    scene = read_scene_folder(train(street, tmp_path / "run", notes, config=config))
    assert scene.actors == ()
    assert not scene.nodes.any()
    assert any("static-only" in note for note in notes)


def test_a_clip_without_cuboids_is_static_and_says_so(street, tmp_path):
    bare, notes = tmp_path / "bare", []
    shutil.copytree(street, bare, ignore=shutil.ignore_patterns("cuboids"))
    scene = read_scene_folder(train(bare, tmp_path / "run", notes))
    assert scene.actors == ()
    assert any("no cuboids" in note for note in notes)


def test_moving_objects_that_lidar_hardly_hits_are_told(street, tmp_path, monkeypatch):
    monkeypatch.setattr(first_gaussians, "MIN_ACTOR_POINTS", 10**9)
    notes = []
    run = train(street, tmp_path / "run", notes)
    assert read_scene_folder(run).actors == ()
    (told,) = [note for note in notes if "moving objects will blur" in note]
    assert "LiDAR points lie in their boxes" in told
    assert json.loads((run / "run.json").read_text())["notes"] == notes


def test_moving_objects_of_a_clip_without_lidar_are_told(street, tmp_path):
    bare, notes = tmp_path / "bare", []
    shutil.copytree(street, bare, ignore=shutil.ignore_patterns("lidar"))
    assert read_scene_folder(train(bare, tmp_path / "run", notes)).actors == ()
    moving = [track for track in load_clip(str(bare), ClipOptions(cameras="1")).tracks if track.moving]
    (told,) = [note for note in notes if "moving objects will blur" in note]
    assert told.startswith(f"{len(moving)} of {len(moving)} ")
    assert "no LiDAR points" in told
    assert f"{moving[0].label} {moving[0].id}" in told


def test_a_run_follows_its_clip_where_asked_and_tells_the_sizes(street, tmp_path):
    notes = []
    request = {"sizes": AskedSizes(iterations=8, max_gaussians=20_000)}
    run = train(street, tmp_path / "run", notes, **request)
    told = json.loads((run / "config.json").read_text())["train"]
    assert (told["geometry"]["iterations"], told["densify"]["max_gaussians"]) == (8, 20_000)
    assert json.loads((run / "run.json").read_text())["iterations"] == 8 + told["instances"]["iterations"]
    assert any("4 training photos along 3 m: 8 iterations, up to 20,000 Gaussians" in note for note in notes)
