"""Damaged files: `python -m benchmarks.fuzz --seconds 60` prints one JSON line. Linux only.

Small whole files of every kind (`fuzz_seeds`) are damaged at random and read, each in a process that may take 5 s and
4 times the files' bytes + 200 MB beyond what it had. Damage that reaches new lines of the program is kept and damaged
further (coverage-guided). What is counted:

- `crashes`: the process died, code out of a file was run, or anything was raised but an `InstDriveError`, warnings
  included;
- `hangs`: reading took over 5 s, twice;
- `overallocations`: more memory was asked for;
- `silent`: a damaged file was read as if whole. That is, values came out that are not finite, or quaternions of length
  zero, and the linter said nothing; or the damage was one that every reader must notice, other values came out than
  from the whole file, and nothing was said: the file was cut off, the header of a .ply or .spz promises another count,
  or a bit is wrong in what a checksum guards (zip, gzip, ZSTD, the arrays of a scene folder). A value that is wrong but
  usable, in a part without checksum, cannot be noticed by anybody. Some cuts are none: a .splat cut between two
  splats is a whole .splat, a list of edits cut between two lines a whole list, and a journal is meant to be read up to
  the line that was torn. Tables of numbers in text and the settings of a run may end anywhere.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import tyro

from benchmarks.fuzz_child import Line, Outcome, serve
from benchmarks.fuzz_containers import inside
from benchmarks.fuzz_layout_seeds import KINDS as LAYOUTS
from benchmarks.fuzz_layout_seeds import ROWS_WITHOUT_COUNT
from benchmarks.fuzz_mutations import BYTES, Damage
from benchmarks.fuzz_seeds import Seed, list_seeds

HANG = 5.0
"""Seconds."""
FOUND = {"crash": "crashes", "hang": "hangs", "overallocation": "overallocations", "silent": "silent"}
"""Results that are faults, and what they are counted as."""
_CORPUS, _MAX_KEPT = 200, 300_000
"""Files of a kind that are damaged further, bytes of one of them."""
_START = 60.0
_SETTINGS = (".yaml", "cfg_args")
"""Endings of text that a program has written for people: lines fewer are settings, too."""


@dataclass(frozen=True)
class Options:
    """How much is tried."""

    seconds: float = 60.0
    """At most."""
    files: int = 1_000_000
    """At most."""
    seed: int = 0
    workers: int = 2
    kinds: tuple[str, ...] = ()
    """Only these readers; default: all."""
    keep: Path | None = None
    """Folder for the files that something was found with."""


@dataclass(frozen=True)
class Case:
    """Damaged files."""

    seed: Seed
    what: str
    must_show: bool
    """Whether reading them must fail, or a finding or note must say so."""


@dataclass
class Corpus:
    """Whole files, and damaged ones that reached new lines, by kind."""

    seeds: tuple[Seed, ...]
    rng: random.Random
    kept: dict[str, list[Seed]] = field(default_factory=dict)

    def draw(self) -> Case:
        """The next case."""
        kind = self.rng.choice(list(dict.fromkeys(seed.kind for seed in self.seeds)))
        whole = [seed for seed in self.seeds if seed.kind == kind]
        kept = self.kept.get(kind, [])
        if kept and self.rng.random() < 0.4:
            parent, is_whole = self.rng.choice(kept), False
        else:
            parent, is_whole = self.rng.choice(whole), True
        times = 1 if is_whole and self.rng.random() < 0.7 else self.rng.choice((1, 2, 4))
        damaged, notes, must_show = parent, [], False
        for _ in range(times):
            damaged, damage = self._damaged(damaged)
            notes.append(damage.what)
            must_show = damage.must_show and is_whole and times == 1
        return Case(damaged, f"{parent.name}: {'; '.join(notes)}", must_show)

    def _damaged(self, seed: Seed) -> tuple[Seed, Damage]:
        files, rng = dict(seed.files), self.rng
        names = [*files, *([seed.entry] if seed.entry in files else [])]
        name: str = rng.choice(names) if names else ""
        match rng.randrange(20):
            case 0 if len(files) > 1:
                del files[name]
                damage = Damage(b"", f"{name} is missing")
            case 1 if len(files) > 1:
                other = rng.choice(list(files))
                files[name], files[other] = files[other], files[name]
                damage = Damage(b"", f"{name} and {other} have changed places")
            case 2:
                other = rng.choice(self.seeds)
                spliced = rng.choice(list(other.files.values()))
                data = files.get(name, b"")
                at, from_ = rng.randrange(len(data) + 1), rng.choice((0, rng.randrange(len(spliced) + 1)))
                files[name] = data[:at] + spliced[from_:]
                damage = Damage(b"", f"{name} spliced at {at} with {other.kind}")
            case row if name and row < 13:
                damage = inside(files[name], rng)
                files[name] = damage.data
            case _:
                damage = rng.choice(BYTES)(files.get(name, b""), rng)
                files[name] = damage.data
        must_show = damage.must_show and not _is_whole_after_all(seed.kind, name, damage)
        return replace(seed, files=files), replace(damage, what=f"{name}: {damage.what}", must_show=must_show)

    def keep(self, seed: Seed) -> None:
        """Damage it further from now on; where there are too many, in place of an old one."""
        if seed.size > _MAX_KEPT:
            return
        kept = self.kept.setdefault(seed.kind, [])
        if len(kept) < _CORPUS:
            kept.append(seed)
        else:
            kept[self.rng.randrange(_CORPUS)] = seed


def _is_whole_after_all(kind: str, name: str, damage: Damage) -> bool:
    if kind == "splat":
        return len(damage.data) % 32 == 0
    if kind in LAYOUTS:
        return name.endswith(ROWS_WITHOUT_COUNT)
    if kind == "street":
        return name.endswith((*ROWS_WITHOUT_COUNT, *_SETTINGS))
    if kind == "edits":
        return damage.data[-1:] in (b"", b"\n", b"}")
    return name.endswith("journal.jsonl")


class Reader:
    """A process that reads files, started again where it dies."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self.case: Case | None = None
        self.whole: dict[tuple[str, str], Outcome] = {}
        """What came of each whole file, by kind and name."""
        self._started = 0.0

    @property
    def pipe(self) -> Connection:
        """Readable when the outcome is there, or the process is dead."""
        assert self._pipe is not None
        return self._pipe

    def begin(self, case: Case, seen: set[Line]) -> None:
        """Write the files and have them read."""
        if self._process is None:
            self._start(seen)
        shutil.rmtree(self._folder, ignore_errors=True)
        for name, data in case.seed.files.items():
            path = self._folder / "case" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
            if b".." in data or b".." in name.encode():
                self._write_outside(case)
        (self._folder / "case").mkdir(parents=True, exist_ok=True)
        self.case, self._started = case, time.monotonic()
        self.pipe.send((case.seed.kind, str(self._folder / "case"), case.seed.entry, case.seed.size))

    def _write_outside(self, case: Case) -> None:
        """Whole files to be found by names that lead out of the folder."""
        whole = next(seed for seed in list_seeds() if (seed.kind, seed.name) == (case.seed.kind, case.seed.name))
        for name, data in whole.files.items():
            for place in (self._folder / "outside" / name, self._folder / name):
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(data)

    def outcome(self) -> Outcome | None:
        """None while it reads."""
        if self.pipe.poll():
            try:
                return self.pipe.recv()
            except (EOFError, OSError):
                return self._dead("crash", "the process died")
        if time.monotonic() - self._started > HANG:
            return self._dead("hang", f"no end after {HANG:g} s")
        return None

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self.pipe.close()
            self._process = None

    def _start(self, seen: set[Line]) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, seen), daemon=True)
        # Threads of their own heaps would reserve memory that nobody asked for.
        with _environment(MALLOC_ARENA_MAX="1", OPENBLAS_NUM_THREADS="1", NUMBA_NUM_THREADS="1"):
            self._process.start()
        theirs.close()
        for seed in list_seeds():  # what is imported or compiled on first use belongs to no file
            self.begin(Case(seed, "", False), seen)
            if not self.pipe.poll(_START):
                raise SystemExit(f"the whole {seed.kind} {seed.name} was not read within {_START:g} s")
            outcome = self.pipe.recv()
            if outcome.result != "read":
                raise SystemExit(f"the whole {seed.kind} {seed.name}: {outcome.result}, {outcome.detail}")
            seen |= set(outcome.new_lines)
            self.whole[seed.kind, seed.name] = outcome

    def _dead(self, result: str, detail: str) -> Outcome:
        process = self._process
        if process is not None:
            process.join(0.2)
            detail += f" (exit status {process.exitcode})" if process.exitcode is not None else ""
        self.stop()
        return Outcome(result, detail, "", (), time.monotonic() - self._started, 0, ())


@contextmanager
def _environment(**changed: str) -> Iterator[None]:
    """Environment variables for the processes started in the block; this one has its own back after it."""
    before = dict(os.environ)
    os.environ |= changed
    try:
        yield
    finally:
        os.environ.clear()
        os.environ |= before


def judge(case: Case, outcome: Outcome, whole_files: Mapping[tuple[str, str], Outcome]) -> Outcome:
    """`silent` where the damage had to show, changed what was read, and nothing was said."""
    if outcome.result != "read" or not case.must_show:
        return outcome
    whole = whole_files[case.seed.kind, case.seed.name]
    if outcome.digest == whole.digest or set(outcome.reported) - set(whole.reported):
        return outcome
    return replace(outcome, result="silent", detail="read as if it were whole")


def fuzz(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    started = time.monotonic()
    seeds = tuple(seed for seed in list_seeds() if not options.kinds or seed.kind in options.kinds)
    corpus, seen = Corpus(seeds, random.Random(options.seed)), set[Line]()
    counts, per_kind = Counter[str](), Counter[tuple[str, str]]()
    slowest = peak = 0.0
    with tempfile.TemporaryDirectory() as name:
        for case, outcome in _outcomes(options, corpus, seen, Path(name), started):
            kind = case.seed.kind
            fault = FOUND.get(outcome.result)
            counts["files"] += 1
            counts[fault or outcome.result] += 1
            per_kind[kind, "files"] += 1
            per_kind[kind, fault or outcome.result] += 1
            slowest, peak = max(slowest, outcome.seconds), max(peak, outcome.peak)
            if fault and options.keep is not None:
                _keep(options.keep / f"{counts['files']:06d}-{kind}-{outcome.result}", case, outcome)
            if set(outcome.new_lines) - seen and outcome.result in ("read", "refused"):
                corpus.keep(case.seed)
            seen |= set(outcome.new_lines)
    kinds = dict.fromkeys(seed.kind for seed in seeds)
    return {
        **{
            name: counts[name] for name in ("files", "crashes", "hangs", "overallocations", "silent", "read", "refused")
        },
        "lines": len(seen),
        "slowest_ms": round(1000 * slowest),
        "peak_mb": round(peak / 1e6, 1),
        "seconds": round(time.monotonic() - started, 1),
        "kinds": {kind: {what: n for (of, what), n in sorted(per_kind.items()) if of == kind} for kind in kinds},
    }


def _outcomes(
    options: Options, corpus: Corpus, seen: set[Line], folder: Path, started: float
) -> Iterator[tuple[Case, Outcome]]:
    """Cases read by several processes at once, each as it is done."""
    readers = [Reader(folder / str(number)) for number in range(options.workers)]
    given = 0
    try:
        while True:
            for reader in readers:
                if reader.case is None and given < options.files and time.monotonic() - started < options.seconds:
                    given += 1
                    reader.begin(corpus.draw(), seen)
            busy = [reader for reader in readers if reader.case is not None]
            if not busy:
                return
            wait([reader.pipe for reader in busy], timeout=0.2)
            for reader in busy:
                outcome = reader.outcome()
                if outcome is None:
                    continue
                case, reader.case = reader.case, None
                assert case is not None
                if outcome.result == "hang":
                    outcome = _again(reader, case, seen)
                yield case, judge(case, outcome, reader.whole)
    finally:
        for reader in readers:
            reader.stop()


def _again(reader: Reader, case: Case, seen: set[Line]) -> Outcome:
    """Read once more: on a busy machine anything may take 5 s once."""
    reader.begin(case, seen)
    while (outcome := reader.outcome()) is None:
        wait([reader.pipe], timeout=0.2)
    reader.case = None
    return outcome


def _keep(folder: Path, case: Case, outcome: Outcome) -> None:
    for name, data in case.seed.files.items():
        path = folder / "case" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (folder / "about.txt").write_text(f"{case.what}\nentry {case.seed.entry}\n{outcome.detail}\n", errors="replace")


if __name__ == "__main__":
    print(json.dumps(fuzz(tyro.cli(Options))))
