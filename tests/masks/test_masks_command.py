"""`instdrive masks` from folder to folder."""

import pytest
from small_clip import HEIGHT, STEPS, WIDTH, write_exact_labels, write_small_clip

from instdrive_app.main import main
from instdrive_core.cli.masks import create_masks
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import DataError
from instdrive_core.masks import making
from instdrive_core.masks.label_map_folder import open_masks


@pytest.fixture
def root(tmp_path):
    return write_exact_labels(write_small_clip(tmp_path / "clip"))


def test_exact_masks_go_beside_the_photos(root, capsys):
    create_masks(root)
    found = open_masks(root / "masks")
    assert found.source == "exact"
    assert len(found.counts) == 2 * (len(STEPS) - 1)
    assert found.load("front_camera/02").labels.shape == (HEIGHT, WIDTH)
    assert "8 masks in 8 photos, from exact" in capsys.readouterr().out


def test_source_folder_and_part_of_the_clip_can_be_chosen(root, tmp_path, capsys):
    create_masks(root, "annotations", tmp_path / "out", 4, ClipOptions(cameras="front_camera", scale=0.5, last_frame=3))
    found = open_masks(tmp_path / "out")
    assert (found.source, found.seed) == ("annotations", 4)
    assert set(found.counts) == {"front_camera/02", "front_camera/03"}
    assert found.load("front_camera/02").labels.shape == (HEIGHT // 2, WIDTH // 2)
    assert "from annotations" in capsys.readouterr().out


def test_a_part_of_the_clip_is_chosen_by_seconds(root, tmp_path):
    assert main(["masks", str(root), "-o", str(tmp_path / "out"), "--first", "0.25s", "--last", "0.5s"]) == 0
    steps = {key.partition("/")[2] for key in open_masks(tmp_path / "out").counts}
    assert steps == {"03", "05"}  # step 4 is held out
    assert main(["masks", str(root), "--first", "9s"]) == 2


def test_a_clip_that_cannot_be_written_is_named(root, capsys):
    (root / "masks").write_text("in the way")
    with pytest.raises(DataError, match=r"masks: cannot be written .* --out"):
        create_masks(root)


def test_a_real_clip_has_no_exact_labels(pandaset_clip, tmp_path):
    with pytest.raises(DataError, match=r"has no exact labels.*--source annotations"):
        create_masks(pandaset_clip, out=tmp_path / "out")


def test_faults_are_put_in_and_told(root, capsys):
    create_masks(root, faults="sam-v1")
    assert open_masks(root / "masks").faults == "sam-v1"
    assert "from exact with the faults sam-v1" in capsys.readouterr().out


def test_imported_masks_and_a_sheet_from_the_command_line(root, tmp_path, capsys):
    create_masks(root)
    source = tmp_path / "elsewhere"
    (root / "masks").rename(source)
    arguments = ["masks", str(root), "--source", "import", "--from", str(source), "--sheet", str(tmp_path / "sheets")]
    assert main(arguments) == 0
    found = open_masks(root / "masks")
    assert (found.source, len(found.counts)) == ("import", 8)
    assert (found.load("front_camera/02").labels == 1).all()
    assert "front_camera.jpg" in capsys.readouterr().out
    assert {file.name for file in (tmp_path / "sheets").iterdir()} == {"front_camera.jpg", "back_camera.jpg"}


def test_an_interrupted_command_says_that_it_goes_on(root, capsys, monkeypatch):
    real = making._make_frame_masks

    def stopped(labels, frame, *others):
        if frame.key == "front_camera/03":
            raise KeyboardInterrupt
        return real(labels, frame, *others)

    monkeypatch.setattr(making, "_make_frame_masks", stopped)
    assert main(["masks", str(root)]) == 130
    monkeypatch.setattr(making, "_make_frame_masks", real)
    capsys.readouterr()
    assert main(["masks", str(root)]) == 0
    output = capsys.readouterr().out
    assert "Going on where it stopped: 2 of 8 photos are done" in output
    assert "8 masks in 8 photos" in output


def test_options_that_do_not_fit_are_named(root, capsys):
    for arguments, message in (
        (["--from", "x"], "--from x is read by --source import only; the source is 'exact'"),
        (["--source", "import"], "name it with --from"),
        (["--sheet", "x.gif"], "a picture is .jpg or .png"),
    ):
        assert main(["masks", str(root), *arguments]) == 2
        assert message in capsys.readouterr().err
    assert not (root / "masks").exists()
