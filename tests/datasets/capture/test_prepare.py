"""Videos and folders become clips; what finds poses is replaced, so that pycolmap is not needed."""

import json

import cv2
import numpy as np
import pytest
from photo_models import photo_model, write_colmap_binary
from PIL import Image

from instdrive_app.main import main
from instdrive_core.datasets.capture import prepare
from instdrive_core.datasets.capture.candidates import Candidate, measure_candidates
from instdrive_core.datasets.capture.choice import PARALLAX, choose_pictures
from instdrive_core.datasets.capture.poses import FoundPoses
from instdrive_core.datasets.capture.prepare import Preparation, prepare_clip
from instdrive_core.datasets.capture.structure import choose_pairs, choose_threads
from instdrive_core.errors import DataError, OptionError

WIDTH, HEIGHT, COUNT, STEP = 160, 120, 30, 4


def wall(rng):
    """A textured wall that a camera may pass."""
    coarse = rng.integers(0, 256, (HEIGHT // 8, (WIDTH + COUNT * STEP) // 8, 3)).astype(np.uint8)
    return cv2.resize(coarse, (WIDTH + COUNT * STEP, HEIGHT), interpolation=cv2.INTER_CUBIC)


def pictures(blurred=()):
    """A camera passes a wall, 4 pixels a picture."""
    texture = wall(np.random.default_rng(0))
    for number in range(COUNT):
        picture = texture[:, number * STEP : number * STEP + WIDTH]
        yield cv2.GaussianBlur(picture, (0, 0), 4) if number in blurred else picture


@pytest.fixture
def video(tmp_path):
    file = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10, (WIDTH, HEIGHT))
    for picture in pictures(blurred=range(1, COUNT, 3)):
        writer.write(np.ascontiguousarray(picture[:, :, ::-1]))
    writer.release()
    return file


@pytest.fixture
def found(monkeypatch):
    """Stands for structure from motion: keeps what it was asked, and writes a model as COLMAP does."""
    asked = []

    def find(folder, names, lens, is_video, on_stage):
        asked.append((names, lens, is_video))
        if len(asked) == 1:
            raise KeyboardInterrupt
        (folder / "images").rename(folder / "kept")
        write_colmap_binary(folder, photo_model())
        return FoundPoses(len(names), 40, 0.5)

    monkeypatch.setattr(prepare, "find_poses", find)
    monkeypatch.setattr(prepare, "require_capture_packages", lambda: None)
    return asked


def ignore(title, done, total):
    """Nobody looks at the progress."""


def test_shift_and_sharpness_are_measured(video):
    measured = measure_candidates(video, lambda done: None)
    assert len(measured) == COUNT
    shifts = [candidate.shift for candidate in measured[1:]]
    assert np.median(shifts) == pytest.approx(STEP / WIDTH, rel=0.1)
    blurred = [candidate.sharpness for candidate in measured[1::3]]
    assert max(blurred) < min(candidate.sharpness for candidate in measured if candidate.number % 3 != 1)


def test_sharp_pictures_apart_from_each_other_are_chosen():
    moving = [Candidate(number, 1.0 + number % 2, PARALLAX / 4) for number in range(80)]
    standing = [Candidate(80 + number, 1.0, 0.0) for number in range(50)]
    chosen = choose_pictures(moving + standing, 200)
    assert 20 <= len(chosen) <= 21
    assert all(number % 2 for number in chosen[:20])  # the sharp ones
    assert len([number for number in chosen if number >= 80]) <= 1  # where the camera stands
    assert 8 <= len(choose_pictures(moving, 10)) <= 10
    with pytest.raises(OptionError, match="--most is 3"):
        choose_pictures(moving, 3)


def test_photos_of_a_video_are_compared_with_their_neighbours():
    assert len(choose_pairs(20, False)) == 190
    pairs = choose_pairs(200, True)
    assert len(pairs) == len(set(pairs)) < 200 * 14
    assert {second - first for first, second in pairs} == {*range(1, 11), 16, 32, 64, 128}


def test_an_interrupted_preparation_goes_on(video, tmp_path, found):
    asked = Preparation(video, tmp_path / "clip")
    with pytest.raises(KeyboardInterrupt):
        prepare_clip(asked, ignore)
    kept = sorted((tmp_path / "clip" / "images").iterdir())
    times = [file.stat().st_mtime_ns for file in kept]
    kept[3].unlink()
    assert prepare_clip(asked, ignore) is not None
    assert found[0] == found[1] == ([file.name for file in kept], "simple", True)
    again = sorted((tmp_path / "clip" / "kept").iterdir())
    assert [file.stat().st_mtime_ns == time for file, time in zip(again, times, strict=True)].count(False) == 1
    assert prepare_clip(asked, ignore) is None


def test_the_command_prints_what_was_found(video, tmp_path, found, capsys):
    out = str(tmp_path / "clip")
    assert main(["prepare", str(video), "-o", out]) == 130
    assert main(["prepare", str(video), "-o", out]) == 0
    assert "photos have poses, 40 points, 0.50 px mean error" in capsys.readouterr().out
    assert main(["prepare", str(video), "-o", out]) == 0
    assert "was finished before: 5 photos with poses" in capsys.readouterr().out
    assert main(["info", out]) == 0
    assert main(["prepare", str(video), "-o", out, "--most", "50"]) == 2
    assert "was begun with most 200, not 50" in capsys.readouterr().err


def test_photos_of_a_folder_are_copied_as_they_are(tmp_path, found):
    source = tmp_path / "photos"
    source.mkdir()
    for number, picture in zip(range(9), pictures(), strict=False):
        Image.fromarray(picture).save(source / f"photo {number}.PNG")
    with pytest.raises(KeyboardInterrupt):
        prepare_clip(Preparation(source, tmp_path / "clip", lens="fisheye"), ignore)
    copies = sorted((tmp_path / "clip" / "images").iterdir())
    assert [file.read_bytes() for file in copies] == [file.read_bytes() for file in sorted(source.iterdir())]
    assert found[0] == ([f"{number:06d}.png" for number in range(9)], "fisheye", False)


def test_sources_that_give_no_clip_are_named(tmp_path, found):
    empty, text = tmp_path / "empty", tmp_path / "text.mp4"
    empty.mkdir()
    text.write_text("no video")
    for source, problem in (
        (tmp_path / "nothing", "there is no such file"),
        (text, "no picture that can be decoded"),
        (empty, "holds no photo"),
    ):
        with pytest.raises(DataError, match=problem):
            prepare_clip(Preparation(source, tmp_path / "clip"), ignore)
    Image.new("RGB", (32, 32)).save(empty / "only.png")
    with pytest.raises(DataError, match="gives 1 usable photo, too few"):
        prepare_clip(Preparation(empty, tmp_path / "clip"), ignore)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "diary.txt").write_text("mine")
    with pytest.raises(OptionError, match="choose another --out"):
        prepare_clip(Preparation(empty, tmp_path / "other"), ignore)


def test_photos_that_lie_on_their_side_are_turned(tmp_path, found):
    source, exif = tmp_path / "photos", Image.Exif()
    source.mkdir()
    exif[0x0112], exif[0x010F] = 6, "maker"
    for number, picture in zip(range(9), pictures(), strict=False):
        Image.fromarray(picture).save(source / f"{number}.jpg", exif=exif if number == 4 else b"")
    with pytest.raises(KeyboardInterrupt):
        prepare_clip(Preparation(source, tmp_path / "clip"), ignore)
    with Image.open(tmp_path / "clip" / "images" / "000004.jpg") as turned, Image.open(source / "4.jpg") as lying:
        assert turned.size == (HEIGHT, WIDTH)
        difference = np.asarray(turned).astype(float) - np.rot90(np.asarray(lying), -1)
        assert np.abs(difference).mean() < 5
        assert dict(turned.getexif()) == {0x010F: "maker"}
    assert (tmp_path / "clip" / "images" / "000003.jpg").read_bytes() == (source / "3.jpg").read_bytes()


def test_what_stands_in_the_way_is_told_before_anything_is_written(tmp_path, found):
    source = tmp_path / "photos"
    source.mkdir()
    for number, picture in zip(range(9), pictures(), strict=False):
        Image.fromarray(picture).save(source / f"{number}.jpg")
    (tmp_path / "file").write_text("mine")
    with pytest.raises(DataError, match=r"file: is no folder. Choose another --out"):
        prepare_clip(Preparation(source, tmp_path / "file" / "clip"), ignore)
    cut = (source / "5.jpg").read_bytes()
    (source / "5.jpg").write_bytes(cut[: len(cut) // 2])
    with pytest.raises(DataError, match=r"photos/5.jpg: is no readable photo .*Take it out of the folder"):
        prepare_clip(Preparation(source, tmp_path / "clip"), ignore)
    assert not (tmp_path / "clip").exists()


def test_memory_bounds_how_many_photos_are_looked_at_side_by_side():
    assert choose_threads((1920, 1080), 16e9, 8) == 8
    assert choose_threads((4096, 3072), 4e9, 16) == 2
    assert choose_threads((8192, 6144), 4e9, 16) == 2  # larger ones are reduced first
    assert choose_threads((4096, 3072), 0.1e9, 16) == 1


def test_a_damaged_state_is_named(video, tmp_path, found):
    asked = Preparation(video, tmp_path / "clip")
    with pytest.raises(KeyboardInterrupt):
        prepare_clip(asked, ignore)
    file = tmp_path / "clip" / "prepare.json"
    state = json.loads(file.read_text())
    for wrong in ([], [-1], "all", [1.5], [True]):
        file.write_text(json.dumps(state | {"pictures": wrong}))
        with pytest.raises(DataError, match="'pictures' is no list of picture numbers"):
            prepare_clip(asked, ignore)
