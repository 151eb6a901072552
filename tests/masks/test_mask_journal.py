"""An interrupted folder of masks goes on where it stopped, with the same recipe only."""

import json
from dataclasses import replace

import numpy as np
import pytest
from painted_street import painted_clip
from PIL import Image

from instdrive_core.masks.faults.registry import FrameFaultSource
from instdrive_core.masks.journal import JOURNAL
from instdrive_core.masks.label_map_folder import SIDECAR, open_masks
from instdrive_core.masks.making import make_masks


class Stopped(Exception):
    pass


@pytest.fixture
def clip(tmp_path):
    """Three training photos and their exact labels."""
    clip = painted_clip(str(tmp_path / "clip"))
    labels = tmp_path / "clip" / "labels"
    for number, frame in enumerate(clip.frames):
        for file, value in ((labels / f"{frame.key}.png", 1), (labels / "sky" / f"{frame.key}.png", 0)):
            file.parent.mkdir(parents=True, exist_ok=True)
            raster = np.full((90, 160), value, np.uint8)
            raster[:number] = 0
            Image.fromarray(raster).save(file)
    table = {"1": {"class": "Road", "kind": "stuff", "moving": False, "uuid": None}}
    (labels / "instances.json").write_text(json.dumps(table))
    return clip


def stop_after(count):
    def on_frame(done):
        if done == count:
            raise Stopped

    return on_frame


def interrupted(clip, folder, count=2, **arguments):
    with pytest.raises(Stopped):
        make_masks(clip, "exact", folder, on_frame=stop_after(count), **arguments)


def progress_of(clip, folder, **arguments):
    told = []
    make_masks(clip, "exact", folder, on_frame=told.append, **arguments)
    return told


def test_an_interrupted_folder_goes_on_and_becomes_the_same(clip, tmp_path, monkeypatch):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    expected = make_masks(clip, "exact", whole, faults="sam-v1")
    interrupted(clip, parts, faults="sam-v1")
    assert not (parts / SIDECAR).exists()
    made = []
    real = FrameFaultSource.load
    monkeypatch.setattr(FrameFaultSource, "load", lambda self, frame: made.append(frame.key) or real(self, frame))
    assert progress_of(clip, parts, faults="sam-v1") == [2, 3]
    assert made == [clip.training_frames[-1].key]
    assert (parts / SIDECAR).read_bytes() == (whole / SIDECAR).read_bytes()
    for key in expected.counts:
        assert (parts / f"{key}.png").read_bytes() == (whole / f"{key}.png").read_bytes()
    assert not (parts / JOURNAL).exists()


@pytest.mark.parametrize("change", [{"seed": 1}, {"faults": "sam-v1"}])
def test_another_recipe_starts_again(clip, tmp_path, change):
    interrupted(clip, tmp_path / "masks")
    assert progress_of(clip, tmp_path / "masks", **change) == [0, 1, 2, 3]


def test_a_finished_folder_is_made_again(clip, tmp_path):
    for _ in range(2):
        assert progress_of(clip, tmp_path / "masks") == [0, 1, 2, 3]


def test_frames_without_files_or_of_another_size_are_made_again(clip, tmp_path):
    folder = tmp_path / "masks"
    first, second, _ = (frame.key for frame in clip.training_frames)
    interrupted(clip, folder)
    (folder / f"{first}_sky.png").unlink()
    assert progress_of(clip, folder) == [1, 2, 3]
    assert set(open_masks(folder).counts) == {frame.key for frame in clip.training_frames}
    interrupted(clip, folder)
    small = replace(clip.frames[0].view.camera, width=80, height=45)
    frames = tuple(replace(frame, view=replace(frame.view, camera=small)) for frame in clip.frames)
    assert progress_of(replace(clip, frames=frames), folder) == [0, 1, 2, 3]
    interrupted(clip, folder)
    only = replace(clip, frames=tuple(frame for frame in clip.frames if frame.key == second))
    assert progress_of(only, folder) == [1]
    assert list(open_masks(folder).counts) == [second], "what the clip's part leaves out is not listed"


@pytest.mark.parametrize("damage", ["", "{", "[]\n", '{"recipe": 1}\n', "\x00"])
def test_a_damaged_journal_counts_as_none(clip, tmp_path, damage):
    interrupted(clip, tmp_path / "masks")
    (tmp_path / "masks" / JOURNAL).write_text(damage)
    assert progress_of(clip, tmp_path / "masks") == [0, 1, 2, 3]


def test_a_line_that_was_cut_off_is_written_again(clip, tmp_path):
    interrupted(clip, tmp_path / "masks")
    file = tmp_path / "masks" / JOURNAL
    file.write_text(file.read_text()[:-9])
    assert progress_of(clip, tmp_path / "masks") == [1, 2, 3]
    interrupted(clip, tmp_path / "masks")
    header = file.read_text().splitlines()[0]
    file.write_text(header + '\n{"frame": 3}\n{"frame": "a/1", "entry": {"width": "x"}}\n')
    assert progress_of(clip, tmp_path / "masks") == [0, 1, 2, 3]
