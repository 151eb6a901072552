"""The store of training views: same views whatever its budget and hints, bounded memory, errors that arrive."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest
from drive import drive
from small_clip import write_small_clip

from instdrive_core.available_memory import assume_memory
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.masks.label_map_folder import FrameMasks, write_masks
from instdrive_core.scene.camera import Camera
from instdrive_core.training.views.photo_budget import LEAST_BUDGET, choose_photo_budget, count_readers
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewFacts, ViewStore, open_view_store

HEIGHT, WIDTH, COUNT = 20, 32, 12
FULL = HEIGHT * WIDTH * 7
"""Bytes of a view: colour, 16-bit label, sky, and what is solid once it is asked for."""
PATIENCE = 120.0
"""Seconds until a thread that never comes counts as a fault."""
ORDER = [(3, True), (0, False), (3, False), (7, True), (0, True), (11, False), (3, True), (0, False), (5, False)]


def view_of(number):
    rng = np.random.default_rng(number)
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[15:] = False
    pixels = np.sort(rng.choice(HEIGHT * WIDTH, 40, replace=False)).astype(np.int32)
    return TrainingView(
        key=f"front_camera/{number:02d}",
        camera=Camera(30.0, 30.0, 16.0, 10.0, WIDTH, HEIGHT, np.eye(4)),
        time=0.1 * number,
        image=rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8),
        valid=valid,
        labels=rng.integers(0, 5, (HEIGHT, WIDTH)).astype(np.uint16),
        sky=rng.random((HEIGHT, WIDTH)) < 0.3,
        depth_pixels=pixels,
        depth_values=rng.uniform(1, 70, 40).astype(np.float32),
    )


class Disk:
    """Makes views and remembers who asked for which; some may be damaged, and reading may be held up."""

    def __init__(self):
        self.read_numbers, self.readers = [], []
        self.damaged = set()
        self.open = threading.Event()
        self.open.set()

    def read(self, number):
        assert self.open.wait(PATIENCE)
        self.read_numbers.append(number)
        self.readers.append(threading.current_thread())
        if number in self.damaged:
            raise DataError(f"{number:02d}.jpg", "is no readable photo", "Get the file again")
        return view_of(number)


@pytest.fixture
def disk():
    return Disk()


def store_on(disk, budget):
    facts = [ViewFacts(f"front_camera/{n:02d}", view_of(n).camera, 0.1 * n, True) for n in range(COUNT)]
    return ViewStore(facts, disk.read, budget)


def settle(store):
    """Wait until nothing is being read ahead."""
    deadline = time.monotonic() + PATIENCE
    while store._workers:
        assert time.monotonic() < deadline
        time.sleep(0.001)


def assert_same(one, other):
    for name in (field.name for field in fields(TrainingView)):
        a, b = getattr(one, name), getattr(other, name)
        if isinstance(a, Camera):
            a, b = a.intrinsics, b.intrinsics
        np.testing.assert_array_equal(a, b, err_msg=name)


@pytest.mark.parametrize("budget", [0, FULL, 3 * FULL, 10**9])
@pytest.mark.parametrize("hints", [0, 2, 30])
def test_views_depend_neither_on_the_budget_nor_on_hints(disk, budget, hints):
    with store_on(disk, budget) as store:
        for turn, (number, coarse) in enumerate(ORDER * 3):
            store.prefetch((ORDER * 3)[turn + 1 : turn + 1 + hints])
            expected = view_of(number).halve() if coarse else view_of(number)
            assert_same(store.get(number, coarse), expected)
            assert store.kept_bytes <= budget


@pytest.mark.parametrize("budget", [0, FULL - 1, FULL, int(2.5 * FULL), 5 * FULL])
def test_memory_stays_within_the_budget(disk, budget):
    rng = np.random.default_rng(0)
    order = [(int(number), bool(coarse)) for number, coarse in rng.integers(0, (COUNT, 2), (200, 2))]
    most = 0
    with store_on(disk, budget) as store:
        for turn, key in enumerate(order):
            store.prefetch(order[turn + 1 : turn + 9])
            store.get(*key)
            most = max(most, store.kept_bytes)
            with store._changed:  # threads read ahead
                kept = [value for value, _ in store._kept.values()]
            assert sum(view.image.nbytes + view.labels.nbytes + view.sky.nbytes for view in kept) <= budget
        settle(store)
        assert store.kept_bytes <= budget
    assert most > budget // 2 or budget < FULL
    assert store.kept_bytes == 0


def test_a_photo_is_read_once_where_memory_suffices(disk):
    store = store_on(disk, 10**9)
    for number, coarse in ORDER * 3:
        assert store.get(number, coarse) is store.get(number, coarse)
    assert sorted(disk.read_numbers) == sorted({number for number, _ in ORDER})


def test_what_was_asked_for_longest_ago_leaves_first(disk):
    store = store_on(disk, 3 * FULL)
    for number in (0, 1, 2, 0, 3):
        store.get(number)
    disk.read_numbers.clear()
    for number in (0, 2, 3):
        store.get(number)
    assert disk.read_numbers == []
    store.get(1)
    assert disk.read_numbers == [1]


def test_hints_are_read_by_another_thread_soonest_first(disk):
    store = store_on(disk, 10**9)
    store.prefetch([(4, False), (2, True), (4, False)])
    settle(store)
    assert disk.read_numbers == [4, 2]
    assert threading.current_thread() not in disk.readers
    assert_same(store.get(2, True), view_of(2).halve())
    store.get(4)
    assert disk.read_numbers == [4, 2]


def test_several_threads_read_ahead_at_once(disk):
    """Three photos are read at a time: none is done before all three are begun."""
    together = threading.Barrier(3)

    def read(number):
        together.wait(PATIENCE)
        return disk.read(number)

    facts = [ViewFacts(f"front_camera/{n:02d}", view_of(n).camera, 0.1 * n, True) for n in range(COUNT)]
    with ViewStore(facts, read, 10**9, readers=3) as store:
        store.prefetch([(number, False) for number in range(6)])
        settle(store)
        assert sorted(disk.read_numbers) == list(range(6))
        assert len(set(disk.readers)) == 3


def test_photos_get_what_they_need_within_a_quarter_of_the_free_memory():
    hd, many = 1920 * 1080, 480
    needed = 1.25 * 7 * hd * many
    with assume_memory(100e9):
        assert choose_photo_budget([hd] * many) == int(needed)
    with assume_memory(8e9):
        assert choose_photo_budget([hd] * many) == int(2e9)
    with assume_memory(0.5e9):
        assert choose_photo_budget([hd] * many) == LEAST_BUDGET
    assert [count_readers(cores) for cores in (1, 2, 4, 8, 16, 64)] == [1, 1, 1, 2, 4, 4]


def test_new_hints_replace_old_ones(disk):
    store = store_on(disk, 10**9)
    disk.open.clear()
    store.prefetch([(number, False) for number in range(6)])
    while not store._reading:
        time.sleep(0.001)
    store.prefetch([(9, False)])
    disk.open.set()
    settle(store)
    assert disk.read_numbers == [0, 9]


def test_no_more_is_read_ahead_than_half_the_budget_holds(disk):
    store = store_on(disk, 4 * FULL)
    store.prefetch([(number, False) for number in range(COUNT)])
    settle(store)
    assert disk.read_numbers == [0, 1]
    disk.read_numbers.clear()
    unbounded = store_on(disk, 10**9)
    unbounded.prefetch([(number % COUNT, False) for number in range(10**5)])
    settle(unbounded)
    assert disk.read_numbers == list(range(COUNT))


def test_an_error_met_while_reading_ahead_is_raised_where_the_view_is_asked_for(disk):
    store = store_on(disk, 10**9)
    disk.damaged = {5}
    store.prefetch([(5, False), (6, False)])
    settle(store)
    assert disk.read_numbers == [5, 6], "reading ahead goes on after an error"
    with pytest.raises(DataError, match=r"05\.jpg: is no readable photo"):
        store.get(5)
    with pytest.raises(DataError, match=r"05\.jpg"):
        store.get(5)
    disk.damaged = set()
    assert_same(store.get(5), view_of(5))


def test_whoever_waits_for_a_photo_that_turns_out_damaged_is_told(disk):
    store = store_on(disk, 10**9)
    disk.damaged = {5}
    disk.open.clear()
    store.prefetch([(5, True)])
    with ThreadPoolExecutor(4) as pool:
        waiting = [pool.submit(store.get, 5, True) for _ in range(4)]
        time.sleep(0.02)
        disk.open.set()
        for future in waiting:
            with pytest.raises(DataError, match=r"05\.jpg"):
                future.result(timeout=PATIENCE)


def test_threads_that_ask_together_share_one_reading(disk):
    store = store_on(disk, 10**9)
    disk.open.clear()
    with ThreadPoolExecutor(8) as pool:
        asked = [pool.submit(store.get, 3) for _ in range(8)]
        disk.open.set()
        views = [future.result(timeout=PATIENCE) for future in asked]
    assert disk.read_numbers == [3]
    assert all(view is views[0] for view in views)


def test_many_threads_get_the_right_views_from_a_small_store(disk):
    store = store_on(disk, 2 * FULL)

    def walk(seed):
        for number, coarse in np.random.default_rng(seed).integers(0, (COUNT, 2), (60, 2)).tolist():
            store.prefetch([(number, not coarse), ((number + 1) % COUNT, bool(coarse))])
            view = store.get(number, bool(coarse))
            assert view.key == f"front_camera/{number:02d}"
            assert view.camera.width == (WIDTH // 2 if coarse else WIDTH)

    with ThreadPoolExecutor(6) as pool:
        for future in [pool.submit(walk, seed) for seed in range(6)]:
            future.result(timeout=PATIENCE)
    settle(store)
    assert store.kept_bytes <= 2 * FULL


def test_closing_ends_reading_ahead(disk):
    store = store_on(disk, 10**9)
    disk.open.clear()
    store.prefetch([(number, False) for number in range(8)])
    while not store._reading:
        time.sleep(0.001)
    (worker,) = store._workers
    opener = threading.Thread(target=open_once_closed, args=(store, disk))
    opener.start()
    store.close()
    opener.join()
    worker.join(PATIENCE)
    assert not worker.is_alive()
    assert disk.read_numbers == [0]
    store.prefetch([(3, False)])
    assert not store._workers
    assert_same(store.get(3), view_of(3))
    assert store.kept_bytes == 0


def open_once_closed(store, disk):
    while not store._closed:
        time.sleep(0.001)
    disk.open.set()


def test_no_thread_is_left_once_all_hints_are_read(disk):
    store = store_on(disk, 10**9)
    disk.open.clear()
    store.prefetch([(number, False) for number in range(4)])
    (worker,) = store._workers
    disk.open.set()
    settle(store)
    worker.join(PATIENCE)
    assert not worker.is_alive()
    assert not any(thread.name == worker.name for thread in threading.enumerate())
    store.prefetch([(2, False), (1, False)])
    assert not store._workers, "all are there already"


def test_views_in_memory_make_a_store():
    views = [view_of(0), replace(view_of(1), labels=None), replace(view_of(2), labels=np.zeros_like(view_of(2).labels))]
    store = ViewStore.from_views(views)
    assert len(store) == 3
    assert [facts.has_masks for facts in store.facts] == [True, False, False]
    assert [facts.step for facts in store.facts] == [0, 1, 2]
    assert store.get(1) is views[1]
    assert_same(store.get(2, True), views[2].halve())
    for wrong in (3, -1):
        with pytest.raises(IndexError, match=f"view {wrong} of 3"):
            store.get(wrong)


def masks_of(clip, folder, skipped=()):
    def content():
        for number, frame in enumerate(clip.training_frames):
            if frame.key not in skipped:
                camera = frame.view.camera
                labels = np.zeros((camera.height, camera.width), np.uint16)
                labels[:2] = number
                yield frame.key, FrameMasks(labels, labels > 2)

    return write_masks(folder, content(), "exact", 0)


def test_facts_of_a_clip_are_known_before_a_photo_is_read(tmp_path):
    def unreadable():
        raise DataError("03.jpg", "is no readable photo", "Get the file again")

    clip = drive()
    clip = replace(clip, frames=tuple(replace(frame, load_image=unreadable) for frame in clip.frames))
    store = open_view_store(clip, masks_of(clip, tmp_path / "masks"))
    assert len(store) == 3
    assert [facts.key for facts in store.facts] == [f"front_camera/0{step}" for step in (3, 5, 6)]
    assert [facts.step for facts in store.facts] == [3, 5, 6]
    assert [facts.has_masks for facts in store.facts] == [False, True, True]
    assert store.facts[0].time == pytest.approx(0.3)
    with pytest.raises(DataError, match=r"03\.jpg"):
        store.get(0)


def test_a_clips_views_carry_photo_masks_and_depth(tmp_path):
    clip = drive()
    store = open_view_store(clip, masks_of(clip, tmp_path / "masks"))
    view, frame = store.get(2), clip.training_frames[2]
    np.testing.assert_array_equal(view.image, frame.load_image())
    assert view.labels[:2].min() == view.labels.max() == 2
    assert view.sky is not None
    assert not view.sky.any()
    assert len(view.depth_pixels) > 100
    bare = open_view_store(clip, None)
    assert bare.get(2).labels is None
    assert not bare.facts[2].has_masks


def test_masks_that_lack_a_photo_are_refused_at_once(tmp_path):
    clip = drive()
    masks = masks_of(clip, tmp_path / "masks", skipped=["front_camera/05"])
    with pytest.raises(DataError, match=r"masks\.json: 1 of 3 training photos have no masks, e\.g\. 'front_camera/05'"):
        open_view_store(clip, masks)


def test_held_out_sweeps_are_never_read():
    clip = drive()
    read = []

    def watched(sweep):
        return replace(sweep, load=lambda: (read.append(sweep.index), sweep.load())[1])

    open_view_store(replace(clip, sweeps=tuple(watched(sweep) for sweep in clip.sweeps)), None)
    assert read == [3, 5, 6], "each once, in order"


@pytest.mark.parametrize("ahead", [False, True])
@pytest.mark.parametrize("content", [b"", b"no photo at all", None])
def test_a_damaged_photo_is_named(tmp_path, content, ahead):
    root = write_small_clip(tmp_path / "clip")
    clip = load_clip(str(root), ClipOptions(cameras="front_camera"))
    photo = root / "camera" / "front_camera" / "05.jpg"
    photo.write_bytes(photo.read_bytes()[:700] if content is None else content)
    with open_view_store(clip, None) as store:
        number = [facts.step for facts in store.facts].index(5)
        if ahead:
            store.prefetch([(number, True)])
        with pytest.raises(DataError, match=r"front_camera/05\.jpg: is no readable photo"):
            store.get(number, True)


def test_the_real_clips_photos_are_what_evaluation_loads(pandaset_clip):
    clip = load_clip(str(pandaset_clip), ClipOptions(cameras="back_camera", first_frame=40, last_frame=42))
    store = open_view_store(clip, None, budget_bytes=480 * 270 * 3)
    for number, frame in enumerate(clip.training_frames):
        store.prefetch([(number, False)])
        view = store.get(number)
        np.testing.assert_array_equal(view.image, frame.load_image())
        assert view.valid is frame.valid
        assert len(view.depth_pixels) > 1000
        assert view.depth_pixels.max() < 480 * 206, "none on the recording car"
        assert store.kept_bytes <= 480 * 270 * 3
