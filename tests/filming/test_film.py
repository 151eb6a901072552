"""Films: their frames show what the path's cameras see, and nothing is left of one that was stopped."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from procedural_street import FIRST_CAR, procedural_street

from instdrive_core.errors import DataError, InstDriveError, OptionError
from instdrive_core.extras import MissingExtraError
from instdrive_core.filming import film
from instdrive_core.filming.camera_path import CameraKey, CameraPath
from instdrive_core.filming.film import FilmSettings, check_film, draw_film, write_film
from instdrive_core.progress import CancelledError, report_to
from instdrive_core.rasterize.pictures import draw_picture

BT709 = 1
SMALL = FilmSettings(64, 48, 4.0)


@pytest.fixture(scope="module")
def scene():
    return procedural_street(0.3)


@pytest.fixture
def path(scene):
    views = scene.views
    return CameraPath([CameraKey(1.0, 0.0, views[0].camera), CameraKey(2.0, 0.5, views[-1].camera)])


@pytest.mark.parametrize("mode", ["color", "instance"])
def test_frames_are_what_a_picture_from_there_shows(scene, path, tmp_path, mode):
    settings = FilmSettings(64, 48, 4.0, mode)
    shares = []
    with report_to(shares.append):
        assert write_film(tmp_path / "film", scene, path, settings) == 5
    assert shares == sorted(shares)
    frames = sorted((tmp_path / "film").iterdir())
    assert [frame.name for frame in frames] == [f"frame_{number:05d}.png" for number in range(1, 6)]
    with Image.open(frames[2]) as picture:
        expected = draw_picture(scene, path.find_camera(1.5, 64, 48), path.find_drive_time(1.5), mode)
        assert np.array_equal(np.asarray(picture), expected)


def test_hidden_splats_are_not_filmed(scene, path):
    settings = FilmSettings(64, 48, 1.0, "instance")
    whole = next(draw_film(scene, path, settings, 1))
    without = next(draw_film(scene, path, settings, 1, scene.instance_ids != FIRST_CAR))
    assert not np.array_equal(whole, without)


def test_depth_has_the_same_colours_in_every_frame(scene, path):
    frames = list(draw_film(scene, path, FilmSettings(64, 48, 100.0, "depth"), 3))
    change = np.abs(np.diff(np.stack(frames).astype(int), axis=0)).mean()
    assert change < 8, "the ramp does not follow each frame's own depths"
    assert frames[0].any()


def test_a_cancelled_film_leaves_nothing(scene, path, tmp_path):
    def stop(share):
        if share > 0.5:
            raise CancelledError("stopped")

    with pytest.raises(CancelledError), report_to(stop):
        write_film(tmp_path / "film", scene, path, SMALL)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "h264"), ("a.webm", "vp9")])
def test_a_video_holds_all_frames(scene, path, tmp_path, name, codec):
    av = pytest.importorskip("av")
    assert write_film(tmp_path / name, scene, path, SMALL) == 5
    with av.open(tmp_path / name) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == codec
        assert stream.average_rate == 4
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == 5
    assert stream.codec_context.color_primaries == BT709
    drawn = next(draw_film(scene, path, SMALL, 5))
    assert np.abs(frames[0].astype(int) - drawn).mean() < 12


def test_players_show_the_colours_of_a_video_as_they_were(scene, path, tmp_path, monkeypatch):
    av = pytest.importorskip("av")
    red = np.full((48, 64, 3), (230, 20, 20), np.uint8)
    monkeypatch.setattr(film, "draw_film", lambda *_: iter([red] * 5))
    for name in ("a.mp4", "a.webm"):
        write_film(tmp_path / name, scene, path, SMALL)
        with av.open(tmp_path / name) as container:
            frame = next(container.decode(video=0))
        shown = frame.reformat(format="rgb24", src_colorspace=BT709).to_ndarray()
        assert np.abs(shown.astype(int) - red).max() < 6, "players take high-definition video for BT.709"


def test_a_cancelled_video_leaves_nothing(scene, path, tmp_path):
    pytest.importorskip("av")

    def stop(share):
        if share > 0.5:
            raise CancelledError("stopped")

    with pytest.raises(CancelledError), report_to(stop):
        write_film(tmp_path / "film.mp4", scene, path, SMALL)
    assert not list(tmp_path.iterdir())


def test_a_video_without_its_package_names_the_extra(scene, path, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(InstDriveError, match=r"instdrive\[video\]") as found:
        write_film(tmp_path / "film.mp4", scene, path, SMALL)
    assert isinstance(found.value, MissingExtraError)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("settings", "name", "problem"),
    [
        (FilmSettings(0, 48), "film", "width is 0"),
        (FilmSettings(64, 9000), "film", "height is 9000"),
        (FilmSettings(63, 48), "film.mp4", "even number"),
        (FilmSettings(64, 48, 0.5), "film", "rate is 0.5"),
        (FilmSettings(64, 48, float("nan")), "film", "rate is nan"),
        (FilmSettings(64, 48, 30.0, "codeword"), "film", "codeword"),
        (FilmSettings(64, 48), "film.avi", "neither in .mp4"),
    ],
)
def test_films_that_cannot_be_made_are_refused(scene, path, tmp_path, settings, name, problem):
    with pytest.raises(OptionError, match=problem):
        write_film(tmp_path / name, scene, path, settings)


def test_a_film_of_hours_is_refused():
    with pytest.raises(OptionError, match="at most"):
        check_film(1e6, SMALL, Path("film"))


def test_frames_are_not_mixed_with_those_of_another_film(scene, path, tmp_path):
    (tmp_path / "frame_00009.png").touch()
    with pytest.raises(DataError, match="not an empty folder"):
        write_film(tmp_path, scene, path, SMALL)
