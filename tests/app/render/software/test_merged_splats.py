"""Drafts with levels of detail against drafts of all splats."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD

from instdrive_app import camera
from instdrive_app.render.software import draw, merged_splats, sparse_splats
from instdrive_app.render.software.draw import FrameRequest, SoftwareDraw
from instdrive_app.render.software.merged_splats import MergedSplats
from instdrive_app.render.software.placed_splats import PlacedSplats
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.state import EditorState, ViewMode, resolve
from instdrive_core.available_memory import assume_memory
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.rasterize.kernels.settings import RasterSettings

SIZE = (300, 180)
BLUE_CAR = FIRST_CAR + 1


class Pair:
    """A document drawn with and without levels of detail."""

    def __init__(self, document):
        self.document, self.watcher = document, SceneWatcher(document)
        self.plain, self.detailed = SoftwareDraw(fewest=10**9), SoftwareDraw(fewest=0)

    def draw(self, index=0, **changes):
        view = self.document.scene.views[index]
        state = EditorState(viewpoint=camera.view_from_camera(view), time=changes.pop("time", view.time), **changes)
        request = FrameRequest(self.watcher.take_state(), resolve(state, *SIZE, draft=True))
        self.detailed(request)
        self.detailed.wait_for_detail()
        again = replace(request, snapshot=replace(request.snapshot, show_sky=not request.snapshot.show_sky))
        self.detailed(again)  # a frame that is kept is not blended anew
        return self.plain(request), self.detailed(request)

    def assert_alike(self, *where, **changes):
        plain, detailed = self.draw(*where, **changes)
        error = (plain.picture[..., :3].astype(float) - detailed.picture[..., :3]) / 255
        assert -10 * np.log10((error**2).mean()) > 32
        return detailed.picture


@pytest.fixture
def pair(street, monkeypatch):
    monkeypatch.setattr(MergedSplats, "adapt", lambda self, seconds: None)  # how fast this machine is decides nothing
    monkeypatch.setattr(merged_splats, "_FIRST", (1.5, 2))
    return Pair(street)


def test_drafts_with_levels_of_detail_look_alike_and_draw_fewer(pair, monkeypatch):
    drawn = []
    choose = MergedSplats.choose
    monkeypatch.setattr(MergedSplats, "choose", lambda *given: drawn.append(choose(*given)) or drawn[-1])
    for index in (0, 3, 6):
        pair.assert_alike(index)
    merged = drawn[-1]
    assert merged.splat_count < len(merged.rows) < len(pair.document.scene)


@pytest.mark.parametrize("merging", [False, True])
def test_pixels_of_drafts_are_means_of_the_sharp_pictures(pair, monkeypatch, merging):
    def compute_error():
        pair.plain, pair.detailed = SoftwareDraw(fewest=10**9), SoftwareDraw(fewest=0)
        draft = pair.draw()[merging].picture[..., :3]
        view = pair.document.scene.views[0]
        state = EditorState(viewpoint=camera.view_from_camera(view), time=view.time)
        sharp = pair.plain(FrameRequest(pair.watcher.take_state(), resolve(state, *SIZE))).picture[..., :3]
        means = sharp.reshape(draft.shape[0], 2, draft.shape[1], 2, 3).mean(axis=(1, 3))
        return ((means - draft) ** 2).mean()

    monkeypatch.setattr(merged_splats, "_FIRST", (1.0, 2))
    error = compute_error()
    monkeypatch.setattr(RasterSettings, "fit_smaller", lambda settings, factor: settings)
    assert error < 0.5 * compute_error()


@pytest.mark.parametrize(
    "edit",
    [
        RecolorInstances((BLUE_CAR, ROAD), "tint", (0.9, 0.4, 0.1)),
        DeleteInstances((BLUE_CAR,)),
        MoveInstances((BLUE_CAR, DRIVING_CAR), (-2.0, 1.0, 0.3), rotation=(0.5**0.5, 0, 0, 0.5**0.5), scale=0.7),
        DuplicateInstances((BLUE_CAR,), (-3.0, 2.0, 0.0)),
    ],
    ids=lambda edit: type(edit).__name__,
)
def test_edits_and_their_undoing_show_at_once(pair, edit):
    before = pair.assert_alike()
    pair.document.apply(edit)
    assert (pair.assert_alike() != before).any(axis=2).mean() > 0.02
    pair.document.undo()
    assert np.abs(pair.assert_alike().astype(int) - before).mean() < 2


def test_what_drives_stays_on_its_track(pair):
    shown = [pair.assert_alike(2, time=time) for time in (0.0, 1.0, 60.0, 0.0)]
    assert (shown[0] != shown[1]).any()
    assert (shown[1] != shown[2]).any()


def test_instances_show_in_their_colours(pair):
    for change in (None, MergeInstances((FIRST_CAR,), BLUE_CAR)):
        if change is not None:
            pair.document.apply(change)
        plain, detailed = pair.draw(view_mode=ViewMode.INSTANCE)
        assert (plain.picture == detailed.picture).all(axis=2).mean() > 0.97
        ids = np.append(pair.document.scene.instance_ids, 0)
        assert (ids[plain.winner] == ids[detailed.winner]).mean() > 0.97


@pytest.mark.parametrize("index", [0, 3])
def test_sharp_frames_leave_out_what_is_out_of_view_and_nothing_else(pair, monkeypatch, index):
    pair.draw(index)
    monkeypatch.setattr(merged_splats, "_WORTH_CULLING", 1.0)  # there are few blocks
    culled = []
    cull = MergedSplats.cull
    monkeypatch.setattr(MergedSplats, "cull", lambda *given: culled.append(cull(*given)) or culled[-1])
    street = pair.document.scene.views[index]
    for turn in (0.0, 2.0):
        look = camera.look(camera.view_from_camera(street), turn, 0.3)
        request = FrameRequest(pair.watcher.take_state(), resolve(EditorState(viewpoint=look, time=street.time), *SIZE))
        plain, detailed = pair.plain(request), pair.detailed(request)
        np.testing.assert_allclose(plain.picture.astype(int), detailed.picture, atol=1)
        assert (plain.picture == detailed.picture).mean() > 0.999
        np.testing.assert_array_equal(plain.winner, detailed.winner)
    assert any(found is not None and len(found.rows) < len(pair.document.scene) / 2 for found in culled)


@pytest.fixture
def adapted(street):
    made = MergedSplats(PlacedSplats(SceneWatcher(street).take_state(), 0.0))
    made.wait()
    return made


@pytest.fixture
def adapting(adapted):
    def adapt(seconds):
        for _ in range(20):
            adapted.adapt(seconds)
        return adapted.factor, adapted.tolerance

    return adapt


def test_drafts_are_whole_where_there_is_time_and_half_where_there_is_none(adapting):
    assert adapting(0.002)[0] == 1
    assert adapting(0.1)[0] == 2
    assert adapting(0.002)[0] == 1


def test_drafts_are_easily_seen_to_be_coarse_only_where_else_they_would_be_slow(adapting):
    assert adapting(1 / 10)[0] == 2
    assert adapting(1 / 10)[1] > 2
    assert adapting(1 / 25) == (2, 2.0)
    factor, tolerance = adapting(1 / 34)
    assert factor == 2
    assert tolerance < 2


def test_drafts_are_whole_again_only_where_that_was_seen_to_be_quick_enough(adapted):
    adapted.tolerance = 5.0
    adapted.adapt(0.06)
    assert adapted.factor == 2
    adapted.adapt(0.02)  # a third of what the whole one took
    adapted.adapt(0.012)
    assert adapted.factor == 2
    adapted.adapt(0.008)
    assert (adapted.factor, adapted.tolerance) == (1, 5.0)


def test_levels_of_detail_are_not_built_while_a_sharp_frame_is_drawn(pair, monkeypatch):
    begun, waits = [], []

    class Noted(MergedSplats):
        def __init__(self, placed, wait_for_turn):
            begun.append(wait_for_turn)
            super().__init__(placed)

    def begin_turn():
        turn = threading.Thread(target=begun[0])
        turn.start()
        turn.join(0.05)
        waits.append((turn, turn.is_alive()))

    monkeypatch.setattr(draw, "MergedSplats", Noted)
    monkeypatch.setattr(draw, "SMOOTH_SECONDS", 0.0)
    view = pair.document.scene.views[0]
    state = EditorState(viewpoint=camera.view_from_camera(view), time=view.time)
    states = [replace(state, show_sky=sky) for sky in (True, False)]
    requests = [FrameRequest(pair.watcher.take_state(), resolve(state, *SIZE)) for state in states]
    pair.detailed(requests[0])
    begin_turn()
    pair.detailed(requests[1], begin_turn)
    (_, after), (during, held) = waits
    during.join(5)
    assert (after, held, during.is_alive()) == (False, True, False)


def test_without_memory_drafts_go_on_without_levels_of_detail(pair):
    with assume_memory(1e5):
        plain, detailed = pair.draw()
    np.testing.assert_array_equal(plain.picture, detailed.picture)


def test_until_levels_of_detail_are_there_drafts_of_large_scenes_show_some_splats_larger(pair, monkeypatch):
    monkeypatch.setattr(draw, "LEAST", 100)
    monkeypatch.setattr(sparse_splats, "MOST", -(-len(pair.document.scene) // 3))
    pair.document.apply(RecolorInstances((BLUE_CAR,), "tint", (0.1, 0.9, 0.1)))
    pair.document.apply(DeleteInstances((FIRST_CAR,)))
    sparse, _ = pair.draw()  # what draws without levels of detail
    rows = np.unique(sparse.winner[sparse.winner >= 0])
    assert len(rows) > 100
    assert (rows % 3 == 0).all(), "every third"
    assert not np.isin(rows, pair.document.find_rows((FIRST_CAR,))).any()
    monkeypatch.setattr(draw, "LEAST", 10**9)
    pair.plain = SoftwareDraw(fewest=10**9)
    plain, _ = pair.draw()
    error = (plain.picture[..., :3].astype(float) - sparse.picture[..., :3]) / 255
    assert 20 < -10 * np.log10((error**2).mean()) < 60
    whole, shown = (np.mean(drawn.winner >= 0) for drawn in (plain, sparse))
    assert abs(whole - shown) < 0.05, "no holes: two were left out of three"
