"""A page in a real browser, without a network: it draws the scene and names what the pointer is on."""

import io

import numpy as np
import pytest
from browser import CHROMIUM, open_browser
from PIL import Image

from instdrive_core.formats.registry import save_scene
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
COUNT = 400
CENTERS = np.array([[-2.0, 8, 0], [2, 8, 0], [0, 8, -2], [-2, 14, 0]])
"""Left, right, below, and hidden behind the left one."""
COLORS = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 1, 0]])
NAMES = {7: "red <b>car</b>", 300: "blue van", 9: "hidden"}
IDS = (7, 300, 0, 9)
POSE = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""At the origin, towards +y."""


def build_balls():
    """Four balls of opaque splats."""
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(4, COUNT, 3))
    offsets *= 0.6 / np.linalg.norm(offsets, axis=2, keepdims=True)
    means = (CENTERS[:, None] + offsets).reshape(-1, 3).astype(np.float32)
    total = len(means)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (total, 1))
    gaussians = Gaussians(
        means=means,
        quats=quats,
        log_scales=np.full((total, 3), np.log(0.08), np.float32),
        opacity_logits=np.full(total, 3.0, np.float32),
        sh_dc=dc_from_color(np.repeat(COLORS, COUNT, axis=0)).astype(np.float32),
        sh_rest=np.zeros((total, 0, 3), np.float32),
        features=np.zeros((total, 0), np.float32),
    )
    ids = np.repeat(np.array(IDS, np.uint32), COUNT)
    table = build_instance_table(ids, means, None, None, NAMES, {7: "car"})
    zeros = np.zeros(total, np.uint32)
    camera = Camera(400.0, 400.0, 400.0, 300.0, 800, 600, POSE)
    return Scene(gaussians, ids, zeros, zeros.astype(np.uint16), table, start=camera)


def read_label(browser, name):
    """Text of a label; None where it is hidden."""
    return browser.evaluate(f"(label => label.hidden ? null : label.innerText)(document.getElementById('{name}'))")


def test_the_page_shows_the_scene_and_names_its_instances(tmp_path):
    path = tmp_path / "balls.html"
    save_scene(path, build_balls())
    with open_browser(tmp_path / "profile") as browser:
        browser.send("Page.navigate", url=path.as_uri())
        browser.wait_for(
            "document.body?.dataset.loaded === 'yes' || document.getElementById('instdrive-problem')?.hidden === false"
        )
        assert read_label(browser, "instdrive-problem") is None
        width, height = browser.evaluate("[innerWidth, innerHeight]")
        focal = 400 * width / 800
        view = Camera(focal, focal, width / 2, height / 2, width, height, POSE)
        pixels = view.project(CENTERS)[0].round().astype(int).tolist()
        (left, right, below, _), empty = pixels, (width // 2, 60)

        def hover(at):
            browser.move(at[0] - 3, at[1])
            browser.move(*at)

        for at, name in ((left, "red <b>car</b>\ncar, ID 7"), (right, "blue van\nID 300")):
            hover(at)
            browser.wait_for(f"document.getElementById('instdrive-hover').innerText === {name!r}")
        for at in (below, empty):
            hover(at)
            browser.wait_for("document.getElementById('instdrive-hover').hidden")
        picture = np.asarray(Image.open(io.BytesIO(browser.photograph())).convert("RGB")).astype(int)
        for at, channel in ((left, 0), (right, 2), (below, 1)):
            color = picture[at[1] - 3 : at[1] + 4, at[0] - 3 : at[0] + 4].mean(axis=(0, 1))
            assert color[channel] > 2 * np.delete(color, channel).max(), color
        browser.click(*left)
        browser.wait_for("document.getElementById('instdrive-picked').innerText.startsWith('red <b>car</b>')")
        assert not browser.problems
        assert {url.split(":")[0] for url in browser.requests} <= {"file", "data", "blob"}
        assert sum(url.startswith("file") for url in browser.requests) == 1
