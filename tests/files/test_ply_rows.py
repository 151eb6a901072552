"""One parser of .ply headers and rows, for scenes and for clouds of points."""

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from instdrive_core.datasets.point_cloud import read_point_ply
from instdrive_core.errors import DataError
from instdrive_core.files.ply_header import read_ply_header, read_ply_layout
from instdrive_core.files.ply_rows import CHUNK_ROWS, read_ply_chunks

COUNT = CHUNK_ROWS + 7
FORMS = {"ascii": (True, "="), "little": (False, "<"), "big": (False, ">")}


def write_points(path, form, elements_before=()):
    """Points and what plyfile makes of them; returns the rows."""
    rng = np.random.default_rng(3)
    columns = [("red", "u1"), ("z", "f8"), ("y", "f4"), ("green", "u1"), ("x", "f4"), ("blue", "u1"), ("id", "i2")]
    rows = np.zeros(COUNT, columns)
    for name, kind in columns:
        rows[name] = (
            rng.integers(-30_000 if kind == "i2" else 0, 256, COUNT) if kind[0] in "iu" else rng.normal(size=COUNT)
        )
    text, order = FORMS[form]
    vertex = PlyElement.describe(rows, "vertex")
    PlyData([*elements_before, vertex], text=text, byte_order=order).write(str(path))
    return rows


@pytest.mark.parametrize("form", FORMS)
def test_rows_of_every_form_are_those_that_were_written(tmp_path, form):
    path = tmp_path / "a.ply"
    rows = write_points(path, form)
    with path.open("rb") as file:
        header = read_ply_header(file, path, path.stat().st_size, "points")
        found = np.concatenate(list(read_ply_chunks(file, header, path)))
    assert (header.count, header.is_ascii, header.noun) == (COUNT, form == "ascii", "points")
    for name in rows.dtype.names:
        np.testing.assert_array_equal(found[name], rows[name], err_msg=name)


@pytest.mark.parametrize("form", FORMS)
def test_points_may_follow_other_elements(tmp_path, form):
    camera = PlyElement.describe(np.zeros(3, [("focal", "f4"), ("width", "u2")]), "camera")
    rows = write_points(tmp_path / "a.ply", form, [camera])
    found = read_point_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(found.points, np.stack([rows[axis] for axis in "xyz"], axis=1).astype(np.float64))
    np.testing.assert_array_equal(found.colors, np.stack([rows[name] for name in ("red", "green", "blue")], axis=1))


def test_points_without_colors_are_grey_and_those_of_floats_are_scaled(tmp_path):
    bare = np.zeros(2, [(axis, "f4") for axis in "xyz"])
    PlyData([PlyElement.describe(bare, "vertex")]).write(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read_point_ply(tmp_path / "a.ply").colors, np.full((2, 3), 128))
    painted = np.zeros(1, [(name, "f4") for name in ("x", "y", "z", "red", "green", "blue")])
    painted["green"], painted["blue"] = 0.5, 7.0
    PlyData([PlyElement.describe(painted, "vertex")]).write(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read_point_ply(tmp_path / "a.ply").colors, [[0, 128, 255]])


def test_points_need_three_axes(tmp_path):
    PlyData([PlyElement.describe(np.zeros(2, [("x", "f4"), ("z", "f4")]), "vertex")]).write(str(tmp_path / "a.ply"))
    with pytest.raises(DataError, match="the points have no y"):
        read_point_ply(tmp_path / "a.ply")


def test_messages_say_what_the_rows_are(tmp_path):
    path = tmp_path / "a.ply"
    write_points(path, "little")
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(DataError, match=f"promises {COUNT} points"):
        read_point_ply(path)


def test_a_layout_is_read_without_the_body(tmp_path):
    path = tmp_path / "a.ply"
    write_points(path, "big")
    with path.open("rb") as file:
        layout = read_ply_layout(file, path)
    assert (layout.order, layout.elements[0].count) == (">", COUNT)
    assert layout.elements[0].build_dtype(">").itemsize == 1 + 8 + 4 + 1 + 4 + 1 + 2
