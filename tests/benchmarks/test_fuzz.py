"""The short form of the benchmark: some hundred damaged files of every kind; and that it would see a fault."""

import multiprocessing
import os
import random
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz import Case, Options, fuzz, judge
from benchmarks.fuzz_child import Outcome, serve
from benchmarks.fuzz_mutations import cut_off
from benchmarks.fuzz_pickles import MARKER, hostile_pickles
from benchmarks.fuzz_readers import READERS, Read
from benchmarks.fuzz_seeds import list_seeds
from instdrive_core.errors import DataError
from instdrive_core.files.restricted_pickle import read_pickle

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc and limits on memory")


@pytest.mark.slow
@linux_only
def test_no_damaged_file_does_harm(monkeypatch):
    # Where others use the cores and nothing is compiled yet, reading a file may take long without being a hang.
    monkeypatch.setattr("benchmarks.fuzz.HANG", 60.0)
    monkeypatch.setattr("benchmarks.fuzz._START", 300.0)
    counts = fuzz(Options(seconds=500, files=400, seed=20))
    wanted = {"files": 400, "crashes": 0, "hangs": 0, "overallocations": 0, "silent": 0}
    assert {name: counts[name] for name in wanted} == wanted, counts
    assert counts["read"] > 20
    assert counts["refused"] > 200


def test_every_reader_has_a_whole_file_that_it_reads(tmp_path, monkeypatch):
    assert {seed.kind for seed in list_seeds()} == set(READERS)
    for number, seed in enumerate(list_seeds()):
        folder = tmp_path / str(number)
        for name, data in seed.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        monkeypatch.chdir(folder)  # a journal's scene is named relative to it
        found = READERS[seed.kind](folder / seed.entry)
        assert found.digest, (seed.kind, seed.name)
        assert not found.unreported, (seed.kind, seed.name)


@pytest.mark.parametrize("name", sorted(hostile_pickles()))
def test_hostile_pickles_are_refused_and_not_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "table.pkl"
    path.write_bytes(hostile_pickles()[name])
    with pytest.raises(DataError):
        read_pickle(path)
    assert not (tmp_path / MARKER).exists()


def divides_by_zero(path):
    return 1 / 0


def dies(path):
    os.abort()


def runs_the_file(path):
    Path(MARKER).touch()
    return Read("")


def leads_out(path):
    with open(path.parent / "outside", "wb"):
        return Read("")


def warns(path):
    return Read(str(np.float32(1) * np.float32(1e38) * np.float32(1e38)))


def takes_memory(path):
    return Read(str(len(bytearray(500 << 20))))


def hides_that_memory_was_short(path):
    try:
        np.empty(1 << 40)
    except MemoryError as error:
        raise DataError(path, "no table", "") from error


def holds_nan(path):
    return Read("", unreported="NaN")


def refuses(path):
    raise DataError(path, "damaged", "")


FAULTS = {
    divides_by_zero: "crash",
    runs_the_file: "crash",
    leads_out: "crash",
    warns: "crash",
    takes_memory: "overallocation",
    hides_that_memory_was_short: "overallocation",
    holds_nan: "silent",
    refuses: "refused",
}


@linux_only
def test_each_fault_would_be_seen(tmp_path):
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    readers = {fault.__name__: fault for fault in (*FAULTS, dies)}
    process = context.Process(target=serve, args=(theirs, (), readers), daemon=True)
    process.start()
    theirs.close()
    for fault, expected in FAULTS.items():
        folder = tmp_path / fault.__name__ / "case"
        folder.mkdir(parents=True)
        ours.send((fault.__name__, str(folder), "", 0))
        outcome = ours.recv()
        assert outcome.result == expected, (fault, outcome.detail)
    ours.send(("dies", str(tmp_path), "", 0))
    with pytest.raises(EOFError):
        ours.recv()
    process.join()


def test_a_cut_file_read_as_if_whole_is_silent_unless_something_is_said():
    seed = next(seed for seed in list_seeds() if seed.kind == "ply")
    whole = {(seed.kind, seed.name): Outcome("read", "", "all", ("one",), 0, 0, ())}
    case = Case(seed, "cut", must_show=True)
    read = replace(next(iter(whole.values())), digest="less")
    assert judge(case, read, whole).result == "silent"
    assert judge(case, replace(read, reported=("one", "two")), whole).result == "read"
    assert judge(case, replace(read, digest="all"), whole).result == "read"
    assert judge(replace(case, must_show=False), read, whole).result == "read"


def test_cuts_that_leave_a_whole_text_need_not_show():
    def must_show(data, kept):
        rng = random.Random()
        rng.choice = lambda places: kept
        return cut_off(data, rng).must_show

    assert must_show(b"1.5 2.25\n3.5 4.75\n", 8)
    assert not must_show(b"1.5 2.25\n3.5 4.75\n", 15)
    assert must_show(b'{"a": 1}\n', 7)
    assert not must_show(b'{"a": 1}\n', 8)
    assert must_show(bytes(range(200)), 199)
