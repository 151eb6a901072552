"""Exports of whole scenes, of parts, of instances one by one and of actors in their own frames."""

import errno
import json
import os

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.objects.poses import read_poses
from instdrive_core.formats.registry import open_scene
from instdrive_core.progress import CancelledError, report_to
from instdrive_core.project.export import export_actors, export_instances, export_scene, make_file_name


@pytest.fixture
def document():
    made = Document(random_scene())
    made.apply(RecolorInstances((2,), "solid", (1.0, 0.25, 0.0)))
    made.apply(DeleteInstances((1,)))
    return made


def test_all_and_some(document, tmp_path):
    count = export_scene(document, tmp_path / "all.ply", 0.3)
    assert count == len(open_scene(tmp_path / "all.ply")) == len(bake_document(document, 0.3))
    rows = document.find_rows((1, 2, 8))
    assert export_scene(document, tmp_path / "some", None, rows) == len(document.find_rows((2, 8)))
    some = open_scene(tmp_path / "some")
    assert [actor.id for actor in some.actors] == ["actor-1"]
    assert {instance.id for instance in some.table} == {2, 8}
    with pytest.raises(OptionError, match="9 s"):
        export_scene(document, tmp_path / "nothing.ply", 9.0, document.find_rows((7, 8)))
    assert not (tmp_path / "nothing.ply").exists()


def test_one_file_per_instance_and_a_listing(document, tmp_path):
    whole = bake_document(document, 0.5)  # actor 7 has left by then
    written = export_instances(document, tmp_path / "parts", (1, 2, 7, 8), 0.5, ".ply")
    assert written.skipped == 2
    assert [path.name for path in written.files] == ["0002_a_b_n.ply", "0008_instance_8.ply"]
    assert written.splats == np.isin(whole.instance_ids, [2, 8]).sum()
    listing = json.loads((tmp_path / "parts" / "instances.json").read_text())
    for path, entry in zip(written.files, listing["instances"], strict=True):
        found = open_scene(path)
        assert (path.name, len(found)) == (entry["file"], entry["count"])
        expected = whole.gaussians.select(np.flatnonzero(whole.instance_ids == entry["id"]))
        np.testing.assert_array_equal(found.gaussians.means, expected.means)
        np.testing.assert_array_equal(found.gaussians.sh_dc, expected.sh_dc)
    assert (listing["time"], listing["origin"]) == (0.5, document.scene.origin.tolist())


@pytest.mark.parametrize("suffix", [".ply", ".spz"])
def test_an_actors_file_and_its_poses_give_the_scene_again(document, tmp_path, suffix):
    written = export_actors(document, tmp_path, (1, 2), suffix)
    assert [path.name for path in written.files] == [f"001_Car{suffix}", f"002_Car{suffix}"]
    time = 0.3
    whole = bake_document(document, time)
    for number, path in enumerate(written.files, start=7):
        track, origin, splats = read_poses(path.with_name(path.name.replace(suffix, ".poses.json")))
        assert splats == path
        np.testing.assert_array_equal(origin, document.scene.origin)
        pose, means = track.interpolate_pose(time), open_scene(splats).gaussians.means
        expected = whole.gaussians.means[whole.instance_ids == number]
        np.testing.assert_allclose(means @ pose[:3, :3].T + pose[:3, 3], expected, atol=5e-4)


def test_a_disk_that_fills_up_is_told_with_what_is_there(document, tmp_path, monkeypatch):
    sync, seen = os.fsync, []

    def full(descriptor):
        seen.append(descriptor)
        if len(seen) == 3:  # of the first, file and folder are flushed
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DataError, match=r"No space left on device.*1 of 2 files were written before") as caught:
        export_instances(document, tmp_path, (2, 3), 0.3, ".splat")
    assert caught.value.path.name == "0003_instance_3.splat"
    assert [path.name for path in tmp_path.iterdir()] == ["0002_a_b_n.splat"], "no listing: it is unfinished"


def test_cancelling_leaves_whole_files_and_no_listing(document, tmp_path):
    export_instances(document, tmp_path, (2, 3), 0.3, ".ply")

    def stop(share):
        if share > 0.7:
            raise CancelledError("enough")

    with report_to(stop), pytest.raises(CancelledError):
        export_instances(document, tmp_path, (2, 3), 0.3, ".ply")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0002_a_b_n.ply", "0003_instance_3.ply"]


def test_a_file_in_the_way_is_no_folder(document, tmp_path):
    (tmp_path / "parts").write_text("mine")
    with pytest.raises(DataError, match="this is a file"):
        export_instances(document, tmp_path / "parts", (2,), 0.3, ".ply")
    assert (tmp_path / "parts").read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "expected"),
    [("parked car 1", "parked_car_1"), ("../../etc/passwd", "etc_passwd"), ("“Größe”", "Größe"), ("...", "unnamed")],
)
def test_names_of_instances_become_names_of_files(name, expected):
    assert make_file_name(name) == expected
