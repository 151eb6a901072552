"""Pages of scenes: what comes back, what they hold, and pages that are none."""

import base64
import dataclasses
import gzip
import json
import re

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.errors import DataError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.web_page.axes import order_for_page, turn_point_for_viewer
from instdrive_core.formats.web_page.content import ABOUT, IDS, SPLATS
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import evaluate_view_colors
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene


def street(seed=0, count=300) -> Scene:
    return dataclasses.replace(random_scene(seed, count, actors=0), sky=None, views=())


@pytest.fixture
def path(tmp_path):
    return tmp_path / "street.html"


def element(page, name):
    return re.search(rf'<script type="text/plain" id="{name}">([^<]*)</script>', page)[1]


def replace_element(path, name, change):
    page = path.read_text()
    content = element(page, name)
    path.write_text(page.replace(content, change(content)))


def test_instances_names_and_directions_come_back(path):
    scene = street()
    save_scene(path, scene)
    found, order = open_scene(path), order_for_page(scene.gaussians.means)
    wanted = scene.gaussians.select(order)
    np.testing.assert_array_equal(found.instance_ids, scene.instance_ids[order])
    np.testing.assert_array_equal(found.origin, scene.origin)
    assert [(entry.id, entry.name, entry.class_name, entry.count) for entry in found.table] == [
        (entry.id, entry.name, entry.class_name, entry.count) for entry in scene.table
    ]
    turns = np.abs(np.sum(found.gaussians.quats * normalize_quaternions(wanted.quats), axis=1))
    assert turns.min() > np.cos(np.radians(1.1) / 2)
    assert found.gaussians.sh_degree == wanted.sh_degree


def test_colours_are_turned_with_the_scene(path):
    """One colour in all splats, so that the palette loses little."""
    scene = street(count=20)
    scene.gaussians.sh_rest[:] = scene.gaussians.sh_rest[:1]
    scene.gaussians.sh_dc[:] = 0.3
    save_scene(path, scene)
    found = open_scene(path).gaussians
    order = order_for_page(scene.gaussians.means)
    wanted = scene.gaussians.select(order)
    directions = np.tile(np.array([[0.6, -0.48, 0.64]], np.float32), (20, 1))
    expected = evaluate_view_colors(wanted.sh_dc, wanted.sh_rest, directions)
    np.testing.assert_allclose(evaluate_view_colors(found.sh_dc, found.sh_rest, directions), expected, atol=0.02)


def test_equal_scenes_make_equal_pages_that_fetch_nothing(tmp_path):
    for name in ("a.html", "b.html"):
        save_scene(tmp_path / name, street())
    page = (tmp_path / "a.html").read_text()
    assert page == (tmp_path / "b.html").read_text()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert not re.search(r'(src|href)="', page)
    script = gzip.decompress(base64.b64decode(element(page, "instdrive-viewer")))
    assert b"createViewer" in script
    assert "Permission is hereby granted" in page


def test_names_cannot_end_the_element_they_stand_in(path):
    scene = street()
    entry = next(iter(scene.table))
    name = "</script><script>alert(1)</script>"
    scene.table.set(dataclasses.replace(entry, name=name))
    save_scene(path, scene)
    assert name not in path.read_text()
    assert open_scene(path).table[entry.id].name == name


def test_the_page_opens_where_the_user_looked_from(path):
    pose = np.array([[1.0, 0, 0, 3], [0, 0, 1, -7], [0, -1, 0, 2], [0, 0, 0, 1]])  # towards +y, up +z
    camera = Camera(100.0, 100.0, 50.0, 50.0, 100, 100, pose)
    save_scene(path, dataclasses.replace(street(), start=camera))
    start = json.loads(element(path.read_text(), ABOUT))["settings"]["cameras"][0]["initial"]
    assert start["position"] == [-3, 2, -7]
    assert start["target"] == [-3, 2, 3]
    assert start["fov"] == pytest.approx(53.13, abs=0.01)
    np.testing.assert_array_equal(turn_point_for_viewer(np.array([0.0, 0, 1])), [0, 1, 0])


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (SPLATS, lambda text: text[:-8] + "????????", "is no base64"),
        (SPLATS, lambda text: text[: len(text) // 8 * 4], r"no whole \.sog"),
        (IDS, lambda text: "AAAA" + text, "are damaged"),
        (IDS, lambda text: "eJxjYGBgAAAABAAB", "have 4 bytes or more, 300 splats have 1200"),
        (ABOUT, lambda text: "[]", "holds a list"),
        (ABOUT, lambda text: text[:-1], "no JSON"),
        (ABOUT, lambda text: re.sub(r'"origin":\[[^,]*', '"origin":["x"', text), "'origin'"),
    ],
)
def test_pages_that_lie_are_refused(path, name, change, said):
    save_scene(path, street())
    replace_element(path, name, change)
    with pytest.raises(DataError, match=said) as caught:
        open_scene(path)
    assert caught.value.path == path


def test_other_pages_are_refused(path):
    for content in ("", "<html><body>hello</body></html>"):
        path.write_text(content)
        with pytest.raises(DataError, match=r"is empty|holds no whole scene"):
            open_scene(path)
