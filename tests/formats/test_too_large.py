"""Scenes larger than memory: refused with the numbers before anything is loaded, or opened in part."""

import math
import tracemalloc

import numpy as np
import pytest
from random_scene import random_scene
from scene_files import SCENE_FILES

from instdrive_core.available_memory import VARIABLE, assume_memory, measure_available_memory
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError, OptionError, SceneTooLargeError, format_gigabytes, format_ordinal
from instdrive_core.formats.allocation import (
    BESIDE_BYTES,
    MEMORY_TO_EDIT,
    MEMORY_TO_READ,
    check_memory,
    count_row_bytes,
)
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project.open import open_document, open_edited_scene, open_project
from instdrive_core.project.save import save_project


@pytest.fixture(params=SCENE_FILES)
def scene_path(request, tmp_path):
    return SCENE_FILES[request.param](tmp_path)


def is_joined(path):
    """Whether a scene is joined from several files: of each of these every k-th splat is kept."""
    return (path / "lod-meta.json").exists()


@pytest.mark.parametrize("keep_every", [2, 3, 7, 1000])
def test_every_kth_splat_is_read(scene_path, keep_every):
    whole, part = open_scene(scene_path), open_scene(scene_path, keep_every)
    if is_joined(scene_path):
        assert len(whole) / keep_every <= len(part) <= len(whole) / keep_every + 3
        return
    rows = slice(None, None, keep_every)
    assert len(part) == math.ceil(len(whole) / keep_every)
    for name, values in whole.gaussians.arrays().items():
        if name != "log_scales":
            np.testing.assert_array_equal(getattr(part.gaussians, name), values[rows], err_msg=name)
    for name in ("instance_ids", "codewords", "nodes"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[rows], err_msg=name)
    assert part.extra.keys() == whole.extra.keys()
    for name, column in whole.extra.items():
        np.testing.assert_array_equal(part.extra[name], column[rows])
    for instance in part.table:
        assert instance.count == np.count_nonzero(part.instance_ids == instance.id)


def test_faces_of_splats_grow_by_what_was_left_out(scene_path):
    if is_joined(scene_path):
        return
    before, after = open_scene(scene_path).gaussians.log_scales[::4], open_scene(scene_path, 4).gaussians.log_scales
    np.testing.assert_allclose(after.min(axis=1), before.min(axis=1))
    grown = np.sort(after, axis=1).sum(axis=1) - np.sort(before, axis=1).sum(axis=1)
    np.testing.assert_allclose(grown, math.log(4), atol=1e-5)


def test_a_scene_too_large_is_refused_with_numbers_and_the_part_that_fits_opens(scene_path):
    whole = open_scene(scene_path)
    with assume_memory(5000), pytest.raises(SceneTooLargeError) as raised:
        open_scene(scene_path)
    error = raised.value
    assert (error.count, error.available) == (len(whole), 5000)
    assert error.needed >= MEMORY_TO_READ * count_row_bytes(
        whole.gaussians.sh_rest.shape[1], whole.gaussians.features.shape[1]
    )
    assert f"{len(whole):,} splats" in str(error)
    if error.keep_every is None:
        return
    assert f"--keep-every {error.keep_every}" in str(error)
    with assume_memory(5000):
        assert len(open_scene(scene_path, error.keep_every)) < len(whole)
        with pytest.raises(SceneTooLargeError):
            open_scene(scene_path, error.keep_every - 1)


def test_nothing_is_allocated_for_a_scene_that_is_refused(tmp_path):
    save_scene(tmp_path / "a.ply", freeze_at_time(random_scene(count=20_000, actors=0), 0.0))
    tracemalloc.start()
    try:
        peaks = []
        for keep_every in (1, 10):
            tracemalloc.reset_peak()
            open_scene(tmp_path / "a.ply", keep_every)
            peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.reset_peak()
        with assume_memory(1e6), pytest.raises(SceneTooLargeError):
            open_scene(tmp_path / "a.ply")
        refused = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    chunk = 8192 * 300  # rows read at a time
    assert peaks[1] < 0.1 * peaks[0] + 2 * chunk
    assert peaks[0] > 20_000 * count_row_bytes(15, 4)
    assert refused < 1e6


def test_what_is_needed_beside_the_rows_counts_too():
    needed = 10 * (MEMORY_TO_READ * 60 + BESIDE_BYTES)
    with assume_memory(needed + 100):
        check_memory("a", 10, 60)
        with pytest.raises(SceneTooLargeError) as raised:
            check_memory("a", 10, 60, passing=needed)
        assert raised.value.keep_every is None, "all but 100 bytes of it pass through"
        with pytest.raises(SceneTooLargeError) as raised:
            check_memory("a", 10, 60, passing=0.75 * needed)
        # A quarter of it and 100 bytes are left.
        assert raised.value.keep_every == math.ceil(needed / (needed / 4 + 100))


def test_editing_needs_more_than_reading(tmp_path):
    save_scene(tmp_path / "a.ply", freeze_at_time(random_scene(actors=0), 0.0))
    size = 200 * count_row_bytes(15, 4)
    with assume_memory((MEMORY_TO_READ + MEMORY_TO_EDIT) / 2 * size):
        open_scene(tmp_path / "a.ply")
        with pytest.raises(SceneTooLargeError, match="every 2nd splat"):
            open_document(tmp_path / "a.ply")
        document, _ = open_document(tmp_path / "a.ply", keep_every=2)
    assert len(document.scene) == 100


def test_projects_remember_which_splats_were_opened(tmp_path):
    save_scene(tmp_path / "a", random_scene(count=300))
    document, _ = open_document(tmp_path / "a", keep_every=3)
    document.apply(SelectRows(np.arange(40)))
    save_project(tmp_path / "p.instdrive", document)
    again = open_project(tmp_path / "p.instdrive")
    assert again.notes == ()
    assert len(again.document.scene) == 100
    np.testing.assert_array_equal(again.document.state.flags, document.state.flags)
    with pytest.raises(OptionError, match="edits name splats"):
        open_edited_scene(tmp_path / "p.instdrive", keep_every=2)
    with assume_memory(1000), pytest.raises(SceneTooLargeError) as raised:
        open_project(tmp_path / "p.instdrive")
    assert raised.value.keep_every is None, "edits name splats: no smaller part will do"


def test_a_changed_array_of_a_folder_is_noticed_in_part_too(tmp_path):
    save_scene(tmp_path / "a", random_scene())
    arrays = next((tmp_path / "a").glob("*.safetensors"))
    content = bytearray(arrays.read_bytes())
    content[-5] ^= 1
    arrays.write_bytes(content)
    for keep_every in (1, 3):
        with pytest.raises(DataError, match="not those that were saved"):
            open_scene(tmp_path / "a", keep_every)


@pytest.mark.parametrize("keep_every", [0, -1])
def test_no_part_at_all_is_refused(tmp_path, keep_every):
    with pytest.raises(OptionError, match="whole number from 1"):
        open_scene(tmp_path, keep_every)


def test_what_is_said_of_memory_comes_first(monkeypatch):
    assert measure_available_memory() > 1e6
    monkeypatch.setenv(VARIABLE, "0.5")
    assert measure_available_memory() == 5e8
    with assume_memory(7):
        assert measure_available_memory() == 7
    monkeypatch.setenv(VARIABLE, "much")
    assert measure_available_memory() > 1e6


def test_words_for_numbers():
    assert [format_ordinal(number) for number in (2, 3, 4, 11, 21, 112)] == [
        "2nd",
        "3rd",
        "4th",
        "11th",
        "21st",
        "112th",
    ]
    assert [format_gigabytes(size) for size in (48e9, 9.96e9, 3.24e9, 4.2e6)] == ["48 GB", "10 GB", "3.2 GB", "4.2 MB"]
