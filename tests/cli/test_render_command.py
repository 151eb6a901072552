"""`instdrive render`, and that what is exported looks like what was edited."""

import dataclasses

import numpy as np
import pytest
from PIL import Image
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.cli.render import place_orbit_camera
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.queries.bake import bake_document, freeze_at_time
from instdrive_core.filming.camera_path import CameraKey
from instdrive_core.filming.path_file import FIELD, read_camera_path, store_camera_keys, write_camera_path
from instdrive_core.formats.registry import save_scene
from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.instances.table import build_instance_table
from instdrive_core.project.open import open_document
from instdrive_core.project.save import save_project
from instdrive_core.rasterize.pictures import colorize_depth
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene


@pytest.fixture(scope="module")
def scene():
    """Opaque Gaussians big enough to fill pixels, with two moving actors."""
    scene = random_scene(count=300)
    scene.gaussians.log_scales[:] = -1.2
    scene.gaussians.opacity_logits[:] = 3
    return scene


@pytest.fixture
def run(tmp_path, scene):
    save_scene(tmp_path / "run", scene)
    return tmp_path / "run"


@pytest.fixture
def keys(tmp_path, scene):
    """A file with a camera path of half a second."""
    keys = [CameraKey(at, 0.0, view.camera) for at, view in zip((0.0, 0.5), scene.views[:2], strict=True)]
    write_camera_path(tmp_path / "keys.json", keys)
    return tmp_path / "keys.json"


def pixels(path):
    return np.asarray(Image.open(path))


def test_color_is_what_the_rasterizer_shows(run, scene, tmp_path):
    assert main(["render", str(run), "--view", "front_camera/3", "-o", str(tmp_path / "a.png")]) == 0
    expected = view_scene(scene, scene.views[3].camera, scene.views[3].time).color
    np.testing.assert_allclose(pixels(tmp_path / "a.png") / 255, np.clip(expected, 0, 1), atol=0.51 / 255)


def test_instance_and_codeword_pictures_decode_to_ids(run, scene, tmp_path):
    shown = view_scene(scene, scene.views[0].camera, 0.0)
    for mode in ("instance", "codeword"):
        assert main(["render", str(run), "--mode", mode, "-o", str(tmp_path / "a.png")]) == 0
        ids = ids_from_colors(pixels(tmp_path / "a.png"))
        expected = build_instance_map(scene, shown)
        if mode == "codeword":
            expected = np.where(shown.winner >= 0, scene.codewords[shown.winner], 0)
        np.testing.assert_array_equal(ids, expected)
        assert len(np.unique(ids)) > 3


def test_hidden_instances_and_other_times_are_not_drawn(run, tmp_path):
    out = tmp_path / "a.png"
    main(["render", str(run), "--mode", "instance", "-o", str(out)])
    assert {1, 2, 7} <= set(np.unique(ids_from_colors(pixels(out))))
    main(["render", str(run), "--mode", "instance", "--hide", "1", "2", "--time", "9", "-o", str(out)])
    ids = set(np.unique(ids_from_colors(pixels(out))))
    assert not ids & {1, 2, 7, 8}
    assert ids & {3, 4, 5, 6}


def test_a_car_is_drawn_where_it_is_at_the_time(scene, tmp_path):
    times, poses = np.array([0.0, 1.0]), np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = [[-3, 0, 0], [3, 2, 0]]
    driving = dataclasses.replace(scene.actors[0], times=times, world_from_box=poses)
    scene = dataclasses.replace(scene, actors=(driving, scene.actors[1]), gaussians=scene.gaussians.select(slice(None)))
    car = scene.nodes == 1
    scene.gaussians.means[car] *= 0.1
    scene.gaussians.log_scales[car] = -2.0
    save_scene(tmp_path / "run", scene)
    camera, others, shown = scene.views[0].camera, ["--hide", *map(str, (1, 2, 3, 4, 5, 6, 8))], {}
    for time in (0.0, 0.5, 1.0):
        out = tmp_path / f"{time}.png"
        arguments = ["--view", "front_camera/0", "--time", str(time), "-o", str(out)]
        assert main(["render", str(tmp_path / "run"), "--mode", "instance", *others, *arguments]) == 0
        rows, columns = np.nonzero(ids_from_colors(pixels(out)) == 7)
        center, _ = camera.project(driving.interpolate_pose(time)[None, :3, 3])
        assert np.hypot(columns.mean() + 0.5 - center[0, 0], rows.mean() + 0.5 - center[0, 1]) < 2
        assert main(["render", str(tmp_path / "run"), *others, *arguments]) == 0
        shown[time] = pixels(out).astype(int)
    assert (np.abs(shown[0.0] - shown[1.0]).max(axis=2) > 20).sum() > 30, "the car in two places"


def test_all_views_get_a_picture_each(run, tmp_path):
    out = tmp_path / "pictures"
    assert main(["render", str(run), "--all-views", "--mode", "depth", "--width", "32", "-o", str(out)]) == 0
    names = sorted(path.relative_to(out).as_posix() for path in out.rglob("*.png"))
    assert names == [f"front_camera/{index:02d}.png" for index in range(5)]
    assert pixels(out / names[0]).shape == (24, 32, 3)


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        (["--view", "orbit"], (720, 1280, 3)),
        (["--height", "24"], (24, 32, 3)),
        (["--width", "90", "--height", "24"], (24, 90, 3)),
    ],
)
def test_sizes(run, tmp_path, options, shape):
    assert main(["render", str(run), *options, "-o", str(tmp_path / "a.png")]) == 0
    assert pixels(tmp_path / "a.png").shape == shape
    assert pixels(tmp_path / "a.png").std() > 5


def test_a_wider_picture_keeps_the_middle(run, tmp_path):
    for width in ("32", "48"):
        main(["render", str(run), "--width", width, "--height", "24", "-o", str(tmp_path / f"{width}.png")])
    middle = pixels(tmp_path / "48.png")[:, 8:40].astype(int)
    assert np.abs(middle - pixels(tmp_path / "32.png")).max() <= 2


def test_orbit_sees_most_of_a_scene_without_views(scene):
    bare = dataclasses.replace(scene, views=())
    camera = place_orbit_camera(bare, 0.0)
    inside, depth = camera.project(bare.gaussians.means[bare.nodes == 0])
    seen = (depth > 0) & (inside >= 0).all(axis=1) & (inside < [camera.width, camera.height]).all(axis=1)
    assert seen.mean() > 0.8
    assert place_orbit_camera(random_scene(count=0, actors=0), 0.0).position.shape == (3,)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--view", "front_camera/77"], "near it are front_camera/"),
        (["--view", "back_camera/0"], "near it are front_camera/0"),
        (["--view", "orbit", "--all-views"], "exclude each other"),
        (["--all-views", "-o", "OUT.png"], "name a folder"),
        (["-o", "OUT.jpg"], "does not end in .png"),
        (["--hide", "99"], "no instance 99"),
        (["--width", "0"], "--width is 0"),
        (["--height", "99999"], "--height is 99999"),
    ],
)
def test_what_cannot_be_drawn_is_explained(run, tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    out = [] if "-o" in options else ["-o", "a.png"]
    out = ["-o", "folder"] if options == ["--view", "orbit", "--all-views"] else out
    assert main(["render", str(run), *options, *out]) == 2
    assert message in capsys.readouterr().err


def test_depth_runs_from_violet_to_red_and_is_black_where_nothing_is():
    depth = np.geomspace(1, 100, 200, dtype=np.float32).reshape(10, 20)
    there = np.ones_like(depth, bool)
    there[5] = False
    colors = colorize_depth(depth, there).astype(int)
    assert not colors[5].any()
    assert colors[0, 0, 2] > colors[0, 0, 0]
    assert colors[-1, -1, 0] > colors[-1, -1, 2]
    assert not colorize_depth(depth, np.zeros_like(there)).any()


def test_placed_scenes_look_like_moving_ones(scene):
    camera = scene.views[2].camera
    moving, still = view_scene(scene, camera, 0.3), view_scene(freeze_at_time(scene, 0.3), camera, 0.3)
    np.testing.assert_allclose(still.color, moving.color, atol=2e-3)
    np.testing.assert_allclose(still.alpha, moving.alpha, atol=2e-3)


def test_exported_solid_instances_show_their_color(scene):
    alone = dataclasses.replace(scene, sky=None)
    alone.instance_ids = np.where(scene.nodes == 0, 1, scene.instance_ids).astype(np.uint32)
    alone.table = build_instance_table(alone.instance_ids, scene.gaussians.means, scene.codewords, scene.nodes)
    document = Document(alone)
    document.apply(RecolorInstances((1,), "solid", (0.8, 0.4, 0.2)))
    shown = view_scene(bake_document(document), scene.views[0].camera, 9.0)
    covered = shown.alpha > 0.5
    assert covered.sum() > 200
    expected = shown.alpha[covered][:, None] * np.array([0.8, 0.4, 0.2])
    np.testing.assert_allclose(shown.color[covered], expected, atol=2e-3)


@pytest.mark.parametrize("mode", ["color", "instance", "depth"])
def test_a_path_is_filmed_frame_by_frame(run, keys, tmp_path, capsys, mode):
    command = ["render", str(run), "--path", str(keys), "--rate", "4", "--width", "64", "--height", "40"]
    assert main([*command, "--mode", mode, "-o", str(tmp_path / "film")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'film'}: 3 frames\n"
    frames = sorted((tmp_path / "film").iterdir())
    assert [frame.name for frame in frames] == ["frame_00001.png", "frame_00002.png", "frame_00003.png"]
    assert pixels(frames[0]).shape == (40, 64, 3)
    assert not np.array_equal(pixels(frames[0]), pixels(frames[2]))


def test_a_project_is_filmed_along_its_own_path(run, keys, tmp_path):
    stored = {FIELD: store_camera_keys(read_camera_path(keys))}
    project = tmp_path / "drive.instdrive"
    save_project(project, open_document(run)[0], stored)
    command = ["render", str(project), "--path", str(project), "--rate", "2", "--width", "32", "--height", "20"]
    assert main([*command, "-o", str(tmp_path / "film")]) == 0
    assert len(list((tmp_path / "film").iterdir())) == 2


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--rate", "24"], "--rate 24"),
        (["--path", "KEYS", "--time", "0"], "leave out --view"),
        (["--path", "KEYS", "--mode", "codeword"], "codeword"),
        (["--path", "KEYS", "--width", "0"], "width is 0"),
        (["--path", "gone.json"], "gone.json"),
    ],
)
def test_films_that_cannot_be_made_are_told_of(run, keys, tmp_path, capsys, options, problem):
    options = [str(keys) if option == "KEYS" else option for option in options]
    assert main(["render", str(run), *options, "-o", str(tmp_path / "film")]) == 2
    assert problem in capsys.readouterr().err
    assert not (tmp_path / "film").exists()
