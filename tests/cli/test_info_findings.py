"""`instdrive info`: its findings, its histogram picture, its exit status."""

import numpy as np
import pytest
from PIL import Image
from random_scene import random_gaussians, random_scene

from instdrive_app.main import main
from instdrive_core.cli.histogram_picture import BINS, PANEL, build_histograms, draw_histograms
from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.gaussians import create_empty_gaussians
from instdrive_core.scene.scene import scene_from_gaussians


def sound_gaussians(count=200):
    gaussians = random_gaussians(np.random.default_rng(3), count, features=0)
    gaussians.opacity_logits[:] = np.abs(gaussians.opacity_logits)
    return gaussians


def test_a_sound_file_has_no_findings(tmp_path, capsys):
    save_scene(tmp_path / "a.ply", scene_from_gaussians(sound_gaussians()))
    assert main(["info", str(tmp_path / "a.ply")]) == 0
    assert "findings:     none" in capsys.readouterr().out


def test_findings_name_rows_and_remedy_and_are_no_failure(tmp_path, capsys):
    gaussians = sound_gaussians()
    gaussians.quats[[5, 6, 7, 8]] = 0
    gaussians.means[9] = [1e6, 0, 0]
    save_scene(tmp_path / "a.ply", scene_from_gaussians(gaussians))
    assert main(["info", str(tmp_path / "a.ply")]) == 0
    text = capsys.readouterr().out
    assert "4 splats have a rotation of length 0 (rows 5, 6, 7, …). Best deleted" in text
    assert "(rows 9). Best deleted" in text


@pytest.mark.parametrize("damage", ["cut", "sh", "empty"])
def test_files_that_do_not_open_exit_with_2(tmp_path, capsys, damage):
    path = tmp_path / "a.ply"
    save_scene(path, scene_from_gaussians(sound_gaussians()))
    content = path.read_bytes()
    # Without its last column of SH the header fits no degree any more.
    changed = {"cut": content[:-1], "sh": content.replace(b"property float f_rest_44\n", b""), "empty": b""}
    path.write_bytes(changed[damage])
    assert main(["info", str(path), "--histogram", str(tmp_path / "a.png")]) == 2
    assert "a.ply" in capsys.readouterr().err
    assert not (tmp_path / "a.png").exists()


def test_the_histogram_is_written_on_request(tmp_path, capsys):
    save_scene(tmp_path / "run", random_scene())
    picture = tmp_path / "spread.png"
    assert main(["info", str(tmp_path / "run"), "--histogram", str(picture)]) == 0
    assert str(picture) in capsys.readouterr().out
    with Image.open(picture) as image:
        assert image.size == (2 * PANEL[0], 4 * PANEL[1])
    assert main(["info", str(tmp_path / "run"), "--histogram", str(tmp_path / "a.jpg")]) == 2
    assert ".png" in capsys.readouterr().err


def test_histograms_count_every_splat_once():
    gaussians = sound_gaussians(count=5000)
    gaussians.means[0] = np.nan
    gaussians.means[1] = 1e9
    for histogram in build_histograms(gaussians):
        assert histogram.counts.sum() + histogram.left_out == 5000
        assert histogram.counts.shape == (BINS,)
        assert histogram.left_out <= 0.01 * 5000
    opacity, longest = build_histograms(gaussians)[:2]
    assert opacity.left_out == 0
    np.testing.assert_array_equal(opacity.counts, np.histogram(gaussians.opacities, BINS, (0, 1))[0])
    assert 10**longest.low < np.median(gaussians.scales.max(axis=1)) < 10**longest.high


def test_higher_bars_are_drawn_where_more_splats_are():
    gaussians = sound_gaussians(count=1000)
    gaussians.opacity_logits[:900] = 5
    gaussians.opacity_logits[900:] = 0
    panel = draw_histograms(gaussians)[: PANEL[1], : PANEL[0]]
    blue = (panel[..., 2].astype(int) - panel[..., 0] > 100).sum(axis=0)
    middle, right = blue[PANEL[0] // 2 - 10 : PANEL[0] // 2 + 10].max(), blue[-30:].max()
    assert right / middle == pytest.approx(9, rel=0.1)


def test_strange_scenes_are_drawn_too():
    one = sound_gaussians(count=1)
    broken = sound_gaussians(count=3)
    for array in broken.arrays().values():
        array[:] = np.nan
    infinite = sound_gaussians(count=3)
    infinite.log_scales[:] = np.inf
    infinite.opacity_logits[:] = -np.inf
    for gaussians in (create_empty_gaussians(), one, broken, infinite):
        assert draw_histograms(gaussians).shape == (4 * PANEL[1], 2 * PANEL[0], 3)
