"""Which photos a scene's file tells of."""

import json

from small_clip import write_small_clip

from instdrive_core.finding.known_photos import find_known_photos


def test_a_run_names_its_clip_and_another_trainer_its_source(tmp_path):
    clip = write_small_clip(tmp_path / "clip")
    run = tmp_path / "run"
    run.mkdir()
    (run / "run.json").write_text("{}")
    assert find_known_photos(run) is None
    names = ("cameras", "scale", "first_frame", "last_frame", "masks", "seed", "iterations", "train_seconds")
    facts = dict.fromkeys((*names, "peak_rss_mb", "backend"), 0)
    (run / "run.json").write_text(json.dumps({**facts, "clip": str(clip)}))
    assert find_known_photos(run) == clip
    assert find_known_photos(run / "scene.json") == clip
    ply = tmp_path / "inria" / "point_cloud" / "iteration_7000" / "point_cloud.ply"
    ply.parent.mkdir(parents=True)
    assert find_known_photos(ply) is None
    (tmp_path / "inria" / "cfg_args").write_text(f"Namespace(sh_degree=3, source_path='{clip}')")
    assert find_known_photos(ply) == clip


def test_a_scene_beside_its_photos(tmp_path):
    clip = tmp_path / "clip"
    clip.mkdir()
    (clip / "transforms.json").write_text("{}")
    assert find_known_photos(clip / "scene.ply") == clip
    assert find_known_photos(clip / "export" / "scene.ply") == clip
    assert find_known_photos(tmp_path / "scene.ply") is None
