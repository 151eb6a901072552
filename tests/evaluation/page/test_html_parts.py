"""Parts of pages: escaped elements, colours that make maps comparable, charts, logs."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from instdrive_core.evaluation.metrics.segmentation import count_confusion
from instdrive_core.evaluation.page import rendering
from instdrive_core.evaluation.page.cells import Cell, PageTable, build_number_cell
from instdrive_core.evaluation.page.charts import Curve, build_line_chart
from instdrive_core.evaluation.page.map_colors import (
    IGNORED,
    NOTHING,
    OTHER,
    PIECE,
    RIGHT,
    classify_pixels,
    color_bijectively,
    color_matched,
    match_ids,
)
from instdrive_core.evaluation.page.pictures import MAX_WIDTH, Picture, encode_map, encode_photo
from instdrive_core.evaluation.page.rendering import load_environment
from instdrive_core.evaluation.page.views import CaptionedPicture, ViewRow
from instdrive_core.evaluation.training_log import get_column, get_term, read_log
from instdrive_core.instances.colormap import colors_from_ids, ids_from_colors

TRUTH = np.array([[0, 1, 1, 1, 1, 2, 2, 3]], np.uint32)
PREDICTED = np.array([[7, 7, 7, 7, 9, 7, 0, 4]], np.uint32)


HOSTILE = "<b>&\"'\x00\ud800é車"
ESCAPED = "&lt;b&gt;&amp;&#34;&#39;\ufffd\ufffdé車"


def render(macro: str, shown) -> str:
    """One part of a page as HTML."""
    source = f'{{% import "parts.html.j2" as parts %}}{{{{ parts.{macro}(shown) }}}}'
    return load_environment().from_string(source).render(shown=shown)


def test_text_is_escaped_and_markup_is_not():
    template = load_environment().from_string('<p class="{{ text }}">{{ text }}{{ markup }}{{ number }}</p>')
    text = template.render(text=HOSTILE, markup=Markup("<i></i>"), number=3)
    assert text == f'<p class="{ESCAPED}">{ESCAPED}<i></i>3</p>'
    assert text.encode()
    assert load_environment().from_string("{{ text }}").render(text="a\nb\t") == "a\nb\t"


def test_pieces_of_markup_put_together_by_hand_are_text_again():
    template = load_environment().from_string("{{ a + b }}")
    assert template.render(a=Markup("<b>"), b="<i>") == "<b>&lt;i&gt;"


def test_a_name_that_a_template_lacks_is_no_empty_text():
    with pytest.raises(UndefinedError):
        load_environment().from_string("{{ unknown }}").render()


def test_every_part_escapes_what_it_is_told():
    picture = Picture("data:,", 1, 1, HOSTILE)
    cell = Cell(HOSTILE, HOSTILE, picture, HOSTILE)
    chart = build_line_chart(HOSTILE, HOSTILE, [Curve(HOSTILE, np.arange(3.0), np.arange(3.0))])
    parts = {
        "picture": (picture, 2),
        "captioned": (CaptionedPicture(picture, HOSTILE, picture), 5),
        "view_row": (ViewRow(HOSTILE, [CaptionedPicture(None, HOSTILE)]), 2),
        "swatch": (HOSTILE, 1),
        "legend": ({HOSTILE: HOSTILE}, 2),
        "cards": ({HOSTILE: HOSTILE}, 2),
        "cell": (cell, 5),
        "table": (PageTable((HOSTILE,), [[cell]], id=HOSTILE), 7),
        "charts": ([chart], 4),
    }
    for macro, (shown, count) in parts.items():
        html = render(macro, shown)
        assert html.count(ESCAPED) == count, macro
        assert "<b>" not in html.replace("<b>" + ESCAPED + "</b>", ""), macro


def test_assets_and_templates_are_installed_with_the_package():
    folder, project = Path(rendering.__file__).parent, Path(__file__).parents[3] / "pyproject.toml"
    patterns = tomllib.loads(project.read_text(encoding="utf-8"))["tool"]["setuptools"]["package-data"]
    packed = {file for pattern in patterns["instdrive_core.evaluation.page"] for file in folder.glob(pattern)}
    assert {file for name in ("assets", "templates") for file in (folder / name).iterdir()} == packed


def test_cells():
    shown = render("table", PageTable(("a", "b"), [[Cell("<td>"), build_number_cell("1", 1.0, "+2", is_best=True)]]))
    assert "<td>&lt;td&gt;</td>" in shown
    assert '<td class="number best" data-value="1.0">1<span class="delta">+2</span></td>' in shown
    assert '<th>a</th><th class="number">b</th>' in shown


def test_a_table_without_rows_says_so():
    assert render("table_or_none", PageTable(("a",), [])) == '<p class="dim">None.</p>'


def test_the_match_leaves_out_pairs_that_share_nothing():
    assert match_ids(count_confusion(TRUTH, PREDICTED)) == {7: 1, 4: 3}


def test_what_became_of_each_pixel():
    categories = classify_pixels(TRUTH, PREDICTED, {7: 1, 4: 3})
    assert categories.tolist() == [[IGNORED, RIGHT, RIGHT, RIGHT, PIECE, OTHER, NOTHING, RIGHT]]


def test_codewords_of_64_bits_are_compared_whole():
    predicted = PREDICTED.astype(np.uint64) + np.uint64(1 << 32)
    categories = classify_pixels(TRUTH, predicted, {(1 << 32) + 7: 1})
    assert categories[0, 1] == RIGHT
    assert color_bijectively(predicted).tolist() == colors_from_ids(PREDICTED).tolist()


def test_matched_instances_share_a_colour_and_others_are_grey():
    truth, predicted = np.repeat(TRUTH, 14, axis=0), np.repeat(PREDICTED, 14, axis=0)
    truth_of = {7: 1, 4: 3}
    shown, meant = color_matched(predicted, truth_of), color_matched(truth, {1: 1, 3: 3})
    assert ids_from_colors(meant[:, 1]).tolist() == ids_from_colors(shown[:, 1]).tolist() == [1] * 14
    for picture, columns in ((shown, [4]), (meant, [5, 6])):
        for column_number in columns:
            greys = np.unique(picture[:, column_number], axis=0)
            assert len(greys) == 2, "its own grey, and stripes"
            assert (np.ptp(greys[1].astype(int)) == 0) or (np.ptp(greys[0].astype(int)) == 0)
    assert not shown[:, 6].any(), "no instance is black"
    assert not meant[:, 0].any(), "ignored is black"


def test_maps_are_exact_and_small():
    ids = np.arange(64, dtype=np.uint32).reshape(8, 8)
    assert encode_map(colors_from_ids(ids), "map").source.startswith("data:image/png")
    many = colors_from_ids(np.arange(40000, dtype=np.uint32).reshape(200, 200))
    assert encode_map(many, "many").byte_count > encode_map(many % 2, "few").byte_count


def test_wide_pictures_are_shrunk():
    wide = np.zeros((100, 2 * MAX_WIDTH, 3), np.uint8)
    for picture in (encode_photo(wide, "photo"), encode_map(wide, "map")):
        assert (picture.width, picture.height) == (MAX_WIDTH, 50)
        assert f'width="{MAX_WIDTH}" height="50"' in render("picture", picture)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_charts_stand_on_what_is_finite(logarithmic):
    x, y = np.arange(5000.0), np.linspace(1, 3, 5000)
    y[7], y[9] = np.nan, np.inf
    shown = build_line_chart("<t>", "s", [Curve("a&b", x, y), Curve("empty", x[:0], y[:0])], logarithmic)
    assert shown is not None
    chart = render("chart", shown)
    assert "&lt;t&gt;" in chart
    assert "a&amp;b" in chart
    assert "empty" not in chart
    assert "nan" not in chart
    assert "inf" not in chart.replace("info", "")
    assert len(chart) < 20000, "curves are thinned out"


def test_ticks_are_told_apart():
    x = np.arange(3.0)
    for values in (np.full(3, 100.0), np.array([1e6, 1e6 + 1, 1e6 + 2]), np.array([0.001, 0.0012, 0.0014])):
        shown = build_line_chart("t", "s", [Curve("a", x, values)])
        assert shown is not None
        labels = [tick.label for tick in shown.y_ticks]
        assert len(set(labels)) == len(labels)


def test_charts_of_constant_values_and_of_nothing():
    x = np.arange(3.0)
    assert build_line_chart("t", "s", [Curve("a", x, np.full(3, 2.0))]) is not None
    assert build_line_chart("t", "s", [Curve("a", np.full(3, 5.0), x)]) is not None
    assert build_line_chart("t", "s", [Curve("a", x, np.full(3, np.nan))]) is None
    assert build_line_chart("t", "s", [Curve("a", x, np.zeros(3))], logarithmic=True) is None


def test_logs_are_read_past_damaged_lines(tmp_path):
    assert read_log(tmp_path) == []
    good = '{"stage":"rgb","seconds":1,"loss":0.5,"psnr":null,"gaussians":3,"terms":{"a":1}}'
    other = '{"stage":"rgb","seconds":2,"loss":0.25,"psnr":20,"gaussians":3}'
    (tmp_path / "log.jsonl").write_bytes(b"\xff\xfe\n" + f"{good}\n{other}\n{good[:30]}".encode())
    steps = read_log(tmp_path)
    assert get_column(steps, "loss").tolist() == [0.5, 0.25]
    assert np.isnan(get_column(steps, "psnr")).tolist() == [True, False]
    assert np.isnan(get_term(steps, "a")).tolist() == [False, True]
