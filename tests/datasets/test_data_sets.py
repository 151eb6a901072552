"""Every registered data set: its folders are known, opened, and named where a folder is nothing."""

import dataclasses

import numpy as np
import pytest
from photo_models import photo_model, write_colmap_binary, write_colmap_text, write_nerfstudio
from small_clip import WRITTEN, write_layout, write_small_clip

from instdrive_core.datasets.clip import ClipOptions, is_held_out
from instdrive_core.datasets.registry import DATA_SETS, load_clip
from instdrive_core.errors import DataError, OptionError

WRITERS = {
    "nerfstudio": [write_nerfstudio],
    "COLMAP": [write_colmap_binary, write_colmap_text],
    "PandaSet": [lambda root, model: write_small_clip(root)],
    **{title: [lambda root, model, title=title: write_layout(title, root)] for title in WRITTEN},
}
"""Functions that write a small clip of each data set; a new data set adds its own."""
CASES = [(data_set, write) for data_set in DATA_SETS for write in WRITERS[data_set.title]]


@pytest.fixture(params=CASES, ids=lambda case: case[0].title)
def case(request, tmp_path):
    """A data set and a folder that is laid out like it."""
    data_set, write = request.param
    return data_set, str(write(tmp_path / "clip", photo_model()))


def test_a_folder_is_known_by_its_own_data_set_alone(case):
    data_set, folder = case
    assert [other.title for other in DATA_SETS if other.holds(folder)] == [data_set.title]


def test_a_clip_keeps_what_the_rest_of_the_program_counts_on(case):
    data_set, folder = case
    clip = load_clip(folder, ClipOptions())
    assert clip.frames
    assert [frame.key for frame in clip.frames] == [frame.key for frame in data_set.load(folder, ClipOptions()).frames]
    assert len({frame.key for frame in clip.frames}) == len(clip.frames)
    ranks = {name: rank for rank, name in enumerate(clip.camera_names)}
    order = [(frame.view.index, ranks[frame.view.name]) for frame in clip.frames]
    assert order == sorted(order)
    assert (np.abs(clip.origin) == np.round(np.abs(clip.origin))).all()
    for frame in clip.frames:
        camera = frame.view.camera
        assert frame.view.held_out == is_held_out(frame.view.index)
        assert frame.load_image().shape == (camera.height, camera.width, 3)
        turn = camera.world_from_camera[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    assert len(clip.training_frames) + len(clip.held_out_frames) == len(clip.frames)
    assert clip.sweeps or clip.points is not None
    assert clip.sweeps or any("no LiDAR" in note for note in clip.notes)


def test_part_of_a_clip_at_another_size(case):
    _, folder = case
    whole = load_clip(folder, ClipOptions(scale=1.0))
    steps = sorted({frame.view.index for frame in whole.frames})
    part = load_clip(folder, ClipOptions(cameras="1", scale=0.5, first_frame=steps[1], last_frame=steps[2]))
    assert {frame.view.index for frame in part.frames} == set(steps[1:3])
    assert len(part.camera_names) == 1
    assert part.frames[0].view.camera.width == whole.frames[0].view.camera.width // 2
    first, last = (f"{next(f.view.time for f in whole.frames if f.view.index == step):.6f}s" for step in steps[1:3])
    timed = load_clip(folder, ClipOptions(cameras="1", scale=0.5, first_frame=first, last_frame=last))
    assert [frame.key for frame in timed.frames] == [frame.key for frame in part.frames]
    for wrong in (ClipOptions(cameras="nobody"), ClipOptions(scale=2.0), ClipOptions(first_frame=10**6)):
        with pytest.raises(OptionError):
            load_clip(folder, wrong)


def test_a_folder_that_no_data_set_knows_is_answered_with_what_each_needs(tmp_path):
    with pytest.raises(DataError, match="there is no such folder"):
        load_clip(str(tmp_path / "nowhere"), ClipOptions())
    with pytest.raises(DataError, match="is no driving clip of a known layout") as error:
        load_clip(str(tmp_path), ClipOptions())
    assert all(f"{data_set.title}: {data_set.needs}" in str(error.value) for data_set in DATA_SETS)


def test_titles_are_unique():
    assert len({data_set.title for data_set in DATA_SETS}) == len(DATA_SETS)
    assert {field.name for field in dataclasses.fields(DATA_SETS[0])} == {*("title", "needs", "holds", "load", "write")}
