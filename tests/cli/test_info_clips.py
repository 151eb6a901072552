"""`instdrive info` of a driving clip."""

from small_clip import write_small_clip

from instdrive_app.main import main


def test_info_tells_what_a_clip_holds(tmp_path, capsys):
    assert main(["info", str(write_small_clip(tmp_path))]) == 0
    lines = capsys.readouterr().out.splitlines()
    facts = dict(line.split(":", 1) for line in lines)
    assert facts["layout"].strip() == "PandaSet"
    assert facts["photos"].strip() == "10 of 2 cameras"
    assert "3 sweeps; the first has 6 points of 2 LiDARs, each with its time" in facts["LiDAR"]
    assert "10 of 2 tracks, 1 of them moving (2 Car)" in facts["boxes"]
    assert "5 photos of 64×36, fx 40.0, fy 42.0, 25% of a photo is masked" in facts["  back_camera"]


def test_what_a_clip_lacks_is_said(tmp_path, capsys):
    folder = write_small_clip(tmp_path)
    for file in [*folder.glob("lidar/*.gz"), *folder.glob("annotations/cuboids/*.gz")]:
        file.unlink()
    assert main(["info", str(folder)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "LiDAR: none" in text
    assert "boxes: none" in text
    assert "note: no LiDAR" in text


def test_info_of_a_part_of_a_clip(tmp_path, capsys):
    folder = str(write_small_clip(tmp_path))
    assert main(["info", folder, "--first", "3", "--last", "4"]) == 0
    by_step = capsys.readouterr().out
    assert "2, 3 to 4" in by_step
    assert main(["info", folder, "--first", "3s"]) == 2
    assert "no photo lies in the chosen frames; there are" in capsys.readouterr().err
    assert main(["info", folder, "--first", "soon"]) == 2
    assert "give a time step, e.g. 30, or seconds" in capsys.readouterr().err


def test_a_scene_has_no_first_step(tmp_path, capsys):
    assert main(["info", str(tmp_path), "--first", "3"]) == 2
    assert "choose a part of a driving clip" in capsys.readouterr().err
