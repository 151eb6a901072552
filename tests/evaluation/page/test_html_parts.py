"""Parts of pages: escaped elements, colours that make maps comparable, charts, logs."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.segmentation import count_confusion
from instdrive_core.evaluation.page.charts import Curve, line_chart
from instdrive_core.evaluation.page.elements import Markup, element, joined
from instdrive_core.evaluation.page.map_colors import (
    IGNORED,
    NOTHING,
    OTHER,
    PIECE,
    RIGHT,
    bijective_colors,
    error_categories,
    matched_colors,
    truth_of_predicted,
)
from instdrive_core.evaluation.page.page import number_cell, table
from instdrive_core.evaluation.page.pictures import MAX_WIDTH, map_picture, photo_picture
from instdrive_core.evaluation.training_log import get_column, get_term, read_log
from instdrive_core.instances.colormap import colors_from_ids, ids_from_colors

TRUTH = np.array([[0, 1, 1, 1, 1, 2, 2, 3]], np.uint32)
PREDICTED = np.array([[7, 7, 7, 7, 9, 7, 0, 4]], np.uint32)


def test_text_is_escaped_and_markup_is_not():
    assert element("p", "<b>", Markup("<i></i>"), class_="a\"b'") == (
        '<p class="a&quot;b&#x27;">&lt;b&gt;<i></i></p>'  # as html.escape writes quotes
    )
    assert joined("a & b", None) == "a &amp; b"
    assert element("input", hidden=True, disabled=False, data_value=3) == '<input hidden data-value="3">'
    assert element("td", "\x00\ud800é車\n") == "<td>\ufffd\ufffdé車\n</td>"
    assert element("td", "\ud800").encode()


def test_pieces_of_markup_put_together_by_hand_are_text_again():
    assert joined(Markup("<b>") + "<i>") == "&lt;b&gt;&lt;i&gt;"


def test_cells():
    shown = table(("a", "b"), [["<td>", number_cell("1", 1.0, "+2", "best")]])
    assert "<td>&lt;td&gt;</td>" in shown
    assert '<td class="number best" data-value="1.0">1<span class="delta">+2</span></td>' in shown


def test_the_match_leaves_out_pairs_that_share_nothing():
    assert truth_of_predicted(count_confusion(TRUTH, PREDICTED)) == {7: 1, 4: 3}


def test_what_became_of_each_pixel():
    categories = error_categories(TRUTH, PREDICTED, {7: 1, 4: 3})
    assert categories.tolist() == [[IGNORED, RIGHT, RIGHT, RIGHT, PIECE, OTHER, NOTHING, RIGHT]]


def test_codewords_of_64_bits_are_compared_whole():
    predicted = PREDICTED.astype(np.uint64) + np.uint64(1 << 32)
    categories = error_categories(TRUTH, predicted, {(1 << 32) + 7: 1})
    assert categories[0, 1] == RIGHT
    assert bijective_colors(predicted).tolist() == colors_from_ids(PREDICTED).tolist()


def test_matched_instances_share_a_colour_and_others_are_grey():
    truth, predicted = np.repeat(TRUTH, 14, axis=0), np.repeat(PREDICTED, 14, axis=0)
    truth_of = {7: 1, 4: 3}
    shown, meant = matched_colors(predicted, truth_of), matched_colors(truth, {1: 1, 3: 3})
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
    assert "data:image/png" in map_picture(colors_from_ids(ids), "map")
    many = colors_from_ids(np.arange(40000, dtype=np.uint32).reshape(200, 200))
    assert len(map_picture(many, "many")) > len(map_picture(many % 2, "few"))


def test_wide_pictures_are_shrunk():
    wide = np.zeros((100, 2 * MAX_WIDTH, 3), np.uint8)
    assert f'width="{MAX_WIDTH}" height="50"' in photo_picture(wide, "photo")
    assert f'width="{MAX_WIDTH}" height="50"' in map_picture(wide, "map")


@pytest.mark.parametrize("logarithmic", [False, True])
def test_charts_stand_on_what_is_finite(logarithmic):
    x, y = np.arange(5000.0), np.linspace(1, 3, 5000)
    y[7], y[9] = np.nan, np.inf
    chart = line_chart("<t>", "s", [Curve("a&b", x, y), Curve("empty", x[:0], y[:0])], logarithmic)
    assert chart is not None
    assert "&lt;t&gt;" in chart
    assert "a&amp;b" in chart
    assert "empty" not in chart
    assert "nan" not in chart
    assert "inf" not in chart.replace("info", "")
    assert len(chart) < 20000, "curves are thinned out"


def test_charts_of_constant_values_and_of_nothing():
    x = np.arange(3.0)
    assert line_chart("t", "s", [Curve("a", x, np.full(3, 2.0))]) is not None
    assert line_chart("t", "s", [Curve("a", np.full(3, 5.0), x)]) is not None
    assert line_chart("t", "s", [Curve("a", x, np.full(3, np.nan))]) is None
    assert line_chart("t", "s", [Curve("a", x, np.zeros(3))], logarithmic=True) is None


def test_logs_are_read_past_damaged_lines(tmp_path):
    assert read_log(tmp_path) == []
    good = '{"stage":"rgb","seconds":1,"loss":0.5,"psnr":null,"gaussians":3,"terms":{"a":1}}'
    other = '{"stage":"rgb","seconds":2,"loss":0.25,"psnr":20,"gaussians":3}'
    (tmp_path / "log.jsonl").write_bytes(b"\xff\xfe\n" + f"{good}\n{other}\n{good[:30]}".encode())
    steps = read_log(tmp_path)
    assert get_column(steps, "loss").tolist() == [0.5, 0.25]
    assert np.isnan(get_column(steps, "psnr")).tolist() == [True, False]
    assert np.isnan(get_term(steps, "a")).tolist() == [False, True]
