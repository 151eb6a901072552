"""The protocol on a toy drive whose right answers are known, from memory and from a run folder."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation_scene import DRIVING, PARKED, ROAD, ToyDrive
from two_sided_street import two_sided_clip, two_sided_scene

from instdrive_core.cli.eval import evaluate
from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.evaluation import protocol
from instdrive_core.evaluation.protocol import evaluate_run, evaluate_scene
from instdrive_core.evaluation.tables import describe_split
from instdrive_core.formats.folder.scenes import write_scene_folder
from instdrive_core.instances.table import build_instance_table
from instdrive_core.masks.ground_truth import find_ground_truth

FACTS = {
    "clip": "toy",
    "cameras": "front,side",
    "scale": 1.0,
    "first_frame": None,
    "last_frame": None,
    "masks": "exact",
    "seed": 3,
    "iterations": 10,
    "train_seconds": 1.5,
    "peak_rss_mb": 250,
    "backend": "cpu",
}
NESTED_KEYS = {
    "": ("psnr", "ssim", "psnr_actors", "n_gaussians", "n_instances", "train_seconds", "peak_rss_mb", "iterations"),
    "codeword.per_view.": ("miou", "macc"),
    "codeword.scene.": ("miou", "macc"),
    "per_view.": ("miou", "macc", "miou_majority"),
    "scene.": ("miou", "macc", "pq", "acc25", "acc50", "id_switches", "miou_things", "miou_stuff"),
    "scene.reference_": ("miou", "pq", "miou_things", "miou_stuff"),
    "lidar.": ("ap", "ap50", "ap25", "miou", "vmeasure", "instances_per_object", "objects_per_instance"),
    "click.": ("hit_rate", "iou", "collateral", "residue"),
}
"""Keys that EVALUATION writes."""
EXTRA_KEYS = {
    "lidar.": ("instances_to_cover", "codes_per_object", "objects_per_code"),
    "lidar.reference_": (*NESTED_KEYS["lidar."], "instances_to_cover"),
    "click.": ("residue_kept",),
    "click.reference_": (*NESTED_KEYS["click."], "residue_kept"),
}
KEYS = {prefix + key for nested in (NESTED_KEYS, EXTRA_KEYS) for prefix, keys in nested.items() for key in keys}
KEYS |= {"seed", "clip", "cameras", "masks", "backend", "ground_truth", "tracks"}


def flat(figures: dict, prefix: str = "") -> dict:
    entries: dict = {}
    for key, value in figures.items():
        entries |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return entries


def measured(drive: ToyDrive, **facts) -> dict:
    return flat(evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS | facts).figures)


@pytest.fixture
def run(drive: ToyDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The toy drive as a finished run; its clip is handed over in memory."""
    write_scene_folder(tmp_path, drive.scene)
    (tmp_path / "run.json").write_text(json.dumps(FACTS))
    monkeypatch.setattr(protocol, "load_clip", lambda path, options: drive.clip)
    monkeypatch.setattr(protocol, "find_ground_truth", lambda clip: drive.truth)
    return tmp_path


def test_perfect_ids_on_good_geometry(drive):
    figures = measured(drive)
    assert set(figures) == KEYS
    assert figures["scene.miou"] > 0.7
    assert figures["scene.acc50"] == 1
    assert figures["click.hit_rate"] > 0.85, "some pixels of the thin pole show the road"
    assert figures["scene.pq"] == pytest.approx(figures["scene.miou"])
    assert figures["scene.id_switches"] == 0
    assert figures["scene.reference_miou"] == pytest.approx(figures["scene.miou"], abs=0.05)
    assert figures["codeword.scene.miou"] > 0.7
    assert figures["psnr"] > 15
    assert figures["psnr_actors"] > 12
    assert figures["ssim"] > 0.5
    assert figures["click.residue"] < 0.01
    assert figures["click.collateral"] < 0.05
    assert {key for key, value in figures.items() if value is None} == {key for key in KEYS if "lidar" in key}
    assert figures["train_seconds"] == 1.5
    assert figures["n_instances"] == 4


def test_merged_objects_cost_what_they_should(drive):
    ids = drive.scene.instance_ids
    perfect = measured(drive)
    ids[ids == DRIVING] = PARKED
    merged = measured(drive)
    assert merged["scene.reference_miou"] == perfect["scene.reference_miou"], (
        "the reference does not look at learned IDs"
    )
    assert merged["scene.miou"] < perfect["scene.miou"] - 0.2
    assert merged["click.hit_rate"] < 1
    assert merged["codeword.scene.miou"] == perfect["codeword.scene.miou"]


def test_stuff_in_pieces_wins_majority_matching_only(drive):
    road = drive.scene.instance_ids == ROAD
    far = drive.scene.gaussians.means[:, 1] > 9
    drive.scene.instance_ids[road & far] = 99
    figures = measured(drive)
    assert figures["per_view.miou_majority"] > figures["per_view.miou"]
    assert figures["scene.miou_stuff"] < 0.9


def test_controls_are_near_nothing(drive):
    evaluation = evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS)
    one, random = (evaluation.controls[name]["scene"] for name in ("one ID for all", "random IDs"))
    assert one["miou"] < 0.3
    assert random["miou"] < 0.3
    assert evaluation.held_out_steps == (4, 14)


def test_what_does_not_apply_is_none(drive):
    scene, count = drive.scene, len(drive.scene)
    scene.instance_ids, scene.code_bits = np.zeros(count, np.uint32), 0
    scene.table = build_instance_table(scene.instance_ids, scene.gaussians.means)
    drive.truth.source = "annotations"
    figures = measured(drive)
    empty = ("codeword.", "per_view.", "scene.", "lidar.", "click.")
    assert {key for key, value in figures.items() if value is None} == {key for key in KEYS if key.startswith(empty)}


def test_annotations_measured_with_annotations_are_privileged(drive):
    drive.truth.source = "annotations"
    facts = FACTS | {"masks": "annotations"}
    assert evaluate_scene(drive.scene, drive.clip, drive.truth, facts).privileged
    assert not evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS).privileged


def test_same_figures_from_a_run_folder(drive, run):
    again = flat(evaluate_run(run).figures)
    assert again == measured(drive)


def test_command_prints_a_table_and_writes_the_figures(run, capsys):
    evaluate(run, json=run / "eval.json")
    printed = capsys.readouterr().out
    assert all(row in printed for row in ("reference", "instance", "codeword", "one ID for all", "random IDs"))
    assert "held-out time steps 4, 14" in printed
    assert set(flat(json.loads((run / "eval.json").read_text()))) == KEYS


def test_clip_without_held_out_steps(drive):
    frames = drive.clip.training_frames
    clip = Clip("toy", "toy", np.zeros(3), frames, (), drive.clip.tracks, {}, ("front", "side"))
    with pytest.raises(DataError, match="no held-out time step"):
        evaluate_scene(drive.scene, clip, drive.truth, FACTS)


def test_clip_with_another_origin(drive, run, monkeypatch):
    moved = Clip("toy", "toy", np.array([5.0, 0, 0]), drive.clip.frames, (), drive.clip.tracks, {}, ("front", "side"))
    monkeypatch.setattr(protocol, "load_clip", lambda path, options: moved)
    with pytest.raises(DataError, match="origin"):
        evaluate_run(run)


def test_what_reports_need_comes_along(drive):
    evaluation = evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS)
    rows = {row.id: row for row in evaluation.objects}
    assert rows.keys() == drive.truth.instances.keys()
    assert all(row.predicted_id == number for number, row in rows.items()), "the toy's IDs are the true ones"
    assert np.mean([row.iou for row in rows.values()]) == pytest.approx(evaluation.figures["scene"]["miou"])
    assert evaluation.shared_instances == evaluation.shared_codes == {}
    assert [view.frame.key for view in evaluation.views] == [frame.key for frame in drive.clip.held_out_frames]
    assert evaluation.views[0].with_ids(evaluation.scene.instance_ids).predicted.any()


def test_objects_that_share_an_instance_or_a_code(drive):
    scene = drive.scene
    scene.instance_ids[scene.instance_ids == DRIVING] = PARKED
    scene.codewords[scene.codewords == DRIVING] = ROAD
    evaluation = evaluate_scene(scene, drive.clip, drive.truth, FACTS)
    assert evaluation.shared_instances == {PARKED: (PARKED, DRIVING)}
    assert evaluation.shared_codes == {ROAD: (ROAD, DRIVING)}


def test_bounds_can_be_left_out(drive):
    whole = evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS)
    quick = evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS, with_reference=False)
    assert whole.figures["scene"]["reference_miou"] is not None
    assert quick.figures["scene"]["reference_miou"] is quick.figures["lidar"]["reference_ap"] is None
    assert quick.figures["scene"]["miou"] == whole.figures["scene"]["miou"]
    assert quick.figures["click"]["hit_rate"] == whole.figures["click"]["hit_rate"]


@pytest.mark.parametrize("tracks", ["none", "found", "annotated"])
def test_whatever_tracks_trained_annotated_boxes_and_labels_measure(drive, tracks):
    """The toy's driving box as background, without a track of its own, where it stands halfway."""
    scene, (_, driving) = drive.scene, drive.clip.tracks
    good, is_actor = measured(drive), scene.nodes == 1
    if tracks == "none":
        scene.gaussians.means[is_actor] += driving.interpolate_pose(1.0)[:3, 3].astype(np.float32)
        scene = replace(scene, nodes=np.zeros_like(scene.nodes), actors=())
    figures = measured(ToyDrive(scene, drive.clip, drive.truth), tracks=tracks, masks="lidar")
    assert figures["tracks"] == tracks
    assert figures["psnr_actors"] is not None, "annotated boxes are measured in"
    assert figures["click.residue"] is not None, "as are their deletions"
    if tracks == "none":
        assert figures["scene.miou_things"] < good["scene.miou_things"] - 0.05


def test_no_labels_means_neither_masks_nor_tracks_of_annotations(drive):
    drive.truth.source = "annotations"
    for masks, tracks, expected in (
        ("lidar", "found", True),
        ("sam", "none", True),
        ("lidar", "annotated", False),
        ("annotations", "found", False),
        ("lidar", None, False),
    ):
        facts = FACTS | {"masks": masks, "tracks": tracks}
        evaluation = evaluate_scene(drive.scene, drive.clip, drive.truth, facts, with_reference=False)
        assert evaluation.labels_free is expected, (masks, tracks)
        assert ("(no labels)" in describe_split(evaluation)) is expected


def test_a_clip_with_annotations_has_a_reference_and_an_object_per_region():
    """Two facades of one class, both sides of the road, and a car that no Gaussian's ID knows of."""
    clip = two_sided_clip()
    truth = find_ground_truth(clip)
    stuff = ["Building 1", "Building 2", "Road 1"]
    assert [one.name for one in truth.instances.values() if one.kind == "stuff"] == stuff
    scene = two_sided_scene()
    evaluation = evaluate_scene(scene, clip, truth, FACTS | {"masks": "lidar", "tracks": "none"})
    figures = flat(evaluation.figures)
    assert figures["scene.reference_miou"] > figures["scene.miou"] + 0.2, "its one ID for all is no good"
    assert figures["scene.reference_miou"] > 0.8
    assert figures["scene.reference_miou_things"] > 0.5
    assert {row.name for row in evaluation.objects} >= set(stuff)
    assert figures["lidar.reference_miou"] > figures["lidar.miou"] + 0.3, "points know their regions, too"
