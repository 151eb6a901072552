"""Every theme can be read: WCAG contrast of each text on each ground, fills and hover included."""

import numpy as np
import pytest

from instdrive_app.panels.widgets.theme import HOVER, apply_theme, look_up
from instdrive_app.preferences.instance_colors import SAFE_COLORS, paint_safe_colors
from instdrive_app.preferences.themes import THEMES, blend_colors, measure_contrast
from instdrive_core.instances.colormap import colors_from_ids, ids_from_colors

AA, AAA = 4.5, 7.0
EYES = {
    "all cones": np.eye(3),
    "no red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "no blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
"""Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB."""


def grounds(theme):
    """Every colour that text of the theme can stand on."""
    plain = {name: getattr(theme, name) for name in ("background", "panel", "popup", "raised", "hover")}
    mixed = {f"fill on {below}": blend_colors(theme.accent, theme.fill, ground) for below, ground in plain.items()}
    plates = {f"plate on {value:g}": blend_colors(theme.background, 0.78, (value,) * 3) for value in (0.0, 1.0)}
    return plain, mixed, plates


def test_contrast_is_that_of_the_standard():
    assert measure_contrast((0, 0, 0), (1, 1, 1)) == pytest.approx(21)
    assert measure_contrast((0.4667,) * 3, (1, 1, 1)) == pytest.approx(4.48, abs=0.01)  # "#777 on white", just fails


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_text_is_readable_wherever_it_stands(theme):
    least = AAA if theme.frame_border else AA
    plain, mixed, plates = grounds(theme)
    for name, ground in (plain | mixed | plates).items():
        assert measure_contrast(theme.text, ground) >= least, name
    for text in ("dim", "error", "good", "accent"):
        for name, ground in plain.items():
            assert measure_contrast(getattr(theme, text), ground) >= (least if text == "dim" else AA), (text, name)
    assert measure_contrast(theme.on_accent, theme.accent) >= least


@pytest.mark.parametrize("name", THEMES)
def test_roles_follow_the_theme(name, imgui_context):
    apply_theme(THEMES[name])
    assert look_up(HOVER) == THEMES[name].hover
    assert look_up((0.1, 0.2, 0.3)) == (0.1, 0.2, 0.3)
    apply_theme(THEMES["dark"])


@pytest.fixture
def imgui_context():
    """ImGui without a window."""
    from imgui_bundle import imgui

    before = imgui.get_current_context()
    made = imgui.create_context()
    imgui.set_current_context(made)
    yield
    imgui.destroy_context(made)
    if before is not None:
        imgui.set_current_context(before)


@pytest.mark.parametrize("eye", EYES)
def test_safe_colors_differ_for_every_eye(eye):
    values = SAFE_COLORS / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    labs = to_lab(np.clip(linear @ np.array(EYES[eye]).T, 0, 1))
    apart = np.linalg.norm(labs[:, None] - labs[None], axis=-1)[np.triu_indices(len(labs), 1)]
    assert apart.min() > 20  # ten times what is just noticed


def test_neighbouring_ids_get_different_safe_colors_and_keep_their_own():
    ids = np.arange(0, 3000, dtype=np.uint32)
    shown = paint_safe_colors(ids)
    assert (shown[0] == 0).all()
    assert shown[1:].any(axis=1).all()
    assert (shown[1:-1] != shown[2:]).any(axis=1).all()
    assert len(np.unique(shown[1:], axis=0)) == len(SAFE_COLORS)
    assert (ids_from_colors(colors_from_ids(ids)) == ids).all()


def to_lab(linear):
    """CIE L*a*b* of linear RGB."""
    xyz = linear @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    x, y, z = np.moveaxis(np.cbrt(np.maximum(xyz / [0.9505, 1.0, 1.089], 1e-6)), -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
