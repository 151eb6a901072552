"""Training on from an edited scene: edits are kept, what was deleted stays so, a stopped job gives the same bits."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_clip import write_small_clip
from written_street import TINY, copy_street

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.paint import PaintInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.formats.ply.inria import write_ply
from instdrive_core.improving import settings
from instdrive_core.jobs import desk
from instdrive_core.jobs.job_file import JobRequest, ask_job, locate_project
from instdrive_core.jobs.run_job import run_job
from instdrive_core.project.carrying.edited_rows import find_edited_rows
from instdrive_core.project.carrying.parents_file import PARENTS, read_parents
from instdrive_core.project.open import open_document, open_project
from instdrive_core.project.save import save_project
from instdrive_core.scene.selection import Flag
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, build_train_config

STEPS = 70


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A short run of a small street."""
    folder = tmp_path_factory.mktemp("improve")
    clip = copy_street(TINY, folder / "clip", tmp_path_factory)
    config = build_train_config("instdrive", "demo", seed=1)
    config = replace(
        config,
        init=InitConfig(lidar_points=2_500, near_points=200, far_points=200, actor_points=100),
        geometry=replace(config.geometry, iterations=40, coarse_iterations=4, sky_resolution=8),
        densify=replace(config.densify, max_gaussians=0),
    )
    options = ClipOptions(cameras="1")
    return run_training(RunRequest(clip, folder / "base", options, config), lambda event: None, lambda note: None)


@pytest.fixture(scope="module")
def project(base):
    """The run with a deleted, a moved and a painted instance; the last edit is undone."""
    document, _ = open_document(base)
    large = sorted(document.scene.table, key=lambda entry: -entry.count)
    deleted, moved, painted, kept = (entry.id for entry in large[2:6])
    document.apply(DeleteInstances((deleted,)))
    document.apply(MoveInstances((moved,), (0.5, 0.0, 0.2)))
    document.apply(PaintInstances((painted,), (0.1, 0.2, 0.9)))
    document.apply(RenameInstance(kept, "landmark"))
    document.apply(SelectRows(np.arange(0, len(document.scene), 7)))
    document.apply(DeleteInstances((kept,)))
    document.undo()
    save_project(base.parent / "street.instdrive", document, {"time": 0.2})
    return base.parent / "street.instdrive"


@pytest.fixture(scope="module")
def improved(project, tmp_path_factory):
    """The project, trained on in one go; photos are few, so growing may begin early."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settings, "_GROWING_LOOKS", 1)
        run = tmp_path_factory.mktemp("improved") / "better"
        state = run_job(run, request(project))
    assert state.status == "done"
    assert [stage.name for stage in state.stages] == ["take", "pace", "train", "carry"]
    return run


def request(source, **values):
    asked = {"iterations": STEPS, "evaluate": False, "checkpoint_every": 20, "kind": "improve", **values}
    return JobRequest(str(source), **asked)


def test_rows_keep_their_places_and_what_grew_inherits(base, improved):
    before, after = read_scene_folder(base), read_scene_folder(improved)
    parents = read_parents(improved, len(before))
    assert len(after) == len(parents) > len(before)
    np.testing.assert_array_equal(after.instance_ids, before.instance_ids[parents])
    np.testing.assert_array_equal(after.codewords, before.codewords[parents])
    np.testing.assert_array_equal(after.nodes, before.nodes[parents])
    named = [(entry.id, entry.name, entry.class_name) for entry in before.table]
    assert [(entry.id, entry.name, entry.class_name) for entry in after.table] == named
    assert (after.gaussians.means[: len(before)] != before.gaussians.means).any()
    facts = json.loads((improved / "run.json").read_text())
    assert facts["improved_from"] == str(base)
    assert facts["n_gaussians"] == len(after)


def test_edits_are_done_again_on_the_improved_scene(project, improved):
    ours, theirs = open_project(locate_project(improved)), open_project(project)
    assert ours.notes == ()
    assert ours.view == {"time": 0.2}
    assert [edit.title for edit in ours.document.history.edits if not edit.selects_only] == [
        edit.title for edit in theirs.document.history.edits if not edit.selects_only
    ]
    assert ours.document.history.next == theirs.document.history.next
    count = len(theirs.document.scene)
    parents = read_parents(improved, count)
    np.testing.assert_array_equal(ours.document.state.flags, theirs.document.state.flags[parents])
    assert (ours.document.state.find_mask(Flag.SELECTED)[count:]).any()


def test_what_was_edited_keeps_its_bits_and_photos_bring_nothing_back(base, project, improved):
    """Deleted, moved and painted splats are those of the base, and none has grown from them."""
    before, after = read_scene_folder(base), read_scene_folder(improved)
    document = open_project(project).document
    rows = find_edited_rows(document, len(before))
    assert rows[document.state.find_mask(Flag.DELETED)].all()
    assert np.count_nonzero(rows) > np.count_nonzero(document.state.find_mask(Flag.DELETED))
    for name, array in before.gaussians.arrays().items():
        np.testing.assert_array_equal(getattr(after.gaussians, name)[: len(before)][rows], array[rows], err_msg=name)
    assert not rows[read_parents(improved, len(before))[len(before) :]].any()


def test_a_stopped_job_gives_the_same_bits(project, improved, tmp_path, monkeypatch):
    monkeypatch.setattr(settings, "_GROWING_LOOKS", 1)
    monkeypatch.setattr(desk, "WRITE_SECONDS", 0.0)  # half the steps take less than half a second
    run = tmp_path / "better"

    def stop(state):
        if state.curve and state.curve[-1].iteration >= STEPS // 2:
            ask_job(run, "stop")

    assert run_job(run, request(project), stop).status == "stopped"
    assert not (run / "scene.json").exists()
    assert run_job(run, request(project)).status == "done"
    assert (run / PARENTS).read_bytes() == (improved / PARENTS).read_bytes()
    (ours,), (theirs,) = (list(folder.glob("scene.*.safetensors")) for folder in (run, improved))
    assert ours.name == theirs.name


def test_an_improved_run_is_improved_again_from_another_place_of_the_clip(improved, tmp_path):
    clip = tmp_path / "elsewhere"
    shutil.copytree(json.loads((improved / "run.json").read_text())["clip"], clip)
    run = tmp_path / "best"
    state = run_job(run, request(locate_project(improved), iterations=3, clip=str(clip)))
    assert state.status == "done"
    assert len(open_project(locate_project(run)).document.history.edits) == 6
    assert json.loads((run / "run.json").read_text())["clip"] == str(clip)


def test_what_cannot_train_on_is_refused_with_a_remedy(base, tmp_path):
    scene = read_scene_folder(base)
    write_ply(tmp_path / "foreign.ply", replace(scene, nodes=np.zeros(len(scene), np.uint16), actors=()))
    refuse(tmp_path / "foreign.ply", OptionError, "freeze-geometry", tmp_path)
    refuse(tmp_path / "nothing", DataError, "no such run", tmp_path)
    moved = copy_run(base, tmp_path / "moved", clip=str(tmp_path / "gone"))
    refuse(moved, DataError, "--clip", tmp_path)
    write_small_clip(tmp_path / "other")
    refuse(copy_run(base, tmp_path / "wrong", clip=str(tmp_path / "other")), DataError, "is another clip", tmp_path)
    assert not (tmp_path / "out" / "scene.json").exists()


def refuse(source, error, words, folder):
    with pytest.raises(error, match=words):
        run_job(folder / "out", request(source))


def copy_run(run: Path, target: Path, **facts) -> Path:
    shutil.copytree(run, target)
    found = json.loads((target / "run.json").read_text())
    (target / "run.json").write_text(json.dumps(found | facts))
    return target
