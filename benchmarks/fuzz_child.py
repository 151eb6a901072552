"""The process that reads damaged files for `benchmarks.fuzz`: limited in memory, watched, traced line by line."""

from __future__ import annotations

import gc
import logging
import os
import resource
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from benchmarks.fuzz_pickles import MARKER
from benchmarks.fuzz_readers import READERS, Read
from instdrive_core.errors import InstDriveError
from instdrive_core.formats.usd.stage import load_usd

ALLOWANCE = 200 << 20
"""Bytes that reading any file may take."""
PER_BYTE = 4
"""Bytes more per byte of the files."""
_PACKAGE = f"{os.sep}instdrive_core{os.sep}"

OUTSIDE_ALLOWED = ("project", "journal")
"""Kinds that name scenes which may lie anywhere."""

Line = tuple[str, int]


@dataclass(frozen=True)
class Outcome:
    """What came of reading some files."""

    result: str
    """``read``, ``refused``, ``crash``, ``overallocation``, ``silent``."""
    detail: str
    digest: str
    reported: tuple[str, ...]
    seconds: float
    peak: int
    """Bytes by which resident memory rose."""
    new_lines: tuple[Line, ...]
    """Never run before by this process."""


class LineTracer:
    """Collects which lines of the program run. Code of which all lines were seen is not traced any more."""

    def __init__(self, seen: Iterable[Line]) -> None:
        self._seen = set(seen)
        self._left: dict[CodeType, set[int]] = {}
        self._new: list[Line] = []

    def start(self) -> None:
        """From here on lines are collected, in threads started meanwhile, too."""
        threading.settrace(self._enter)
        sys.settrace(self._enter)

    def stop(self) -> tuple[Line, ...]:
        """The lines that are new since the last call."""
        sys.settrace(None)
        threading.settrace(None)
        found, self._new = tuple(self._new), []
        return found

    def _enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        left = self._left.get(code)
        if left is None:
            left = self._left[code] = self._lines_of(code)
        return self._line if left else None

    def _lines_of(self, code: CodeType) -> set[int]:
        place = code.co_filename.rfind(_PACKAGE)
        if place < 0:
            return set()
        name = code.co_filename[place + 1 :]
        return {line for _, _, line in code.co_lines() if line and (name, line) not in self._seen}

    def _line(self, frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        left = self._left[code]
        if event == "line" and frame.f_lineno in left:
            left.discard(frame.f_lineno)
            line = (code.co_filename[code.co_filename.rfind(_PACKAGE) + 1 :], frame.f_lineno)
            self._seen.add(line)
            self._new.append(line)
        return self._line if left else None


class OpenedOutside:
    """Remembers a file that was opened outside of the folder that is read, but inside of the one around it.

    Names in files must not lead out of their folder; `fuzz.Reader` puts whole files there to be found.
    """

    def __init__(self) -> None:
        self.around, self.inside, self.found = "", "", ""
        sys.addaudithook(self._hear)

    def watch(self, folder: str, kind: str) -> None:
        """From here on; forgets what was found before."""
        self.inside = folder + os.sep
        self.around = "" if kind in OUTSIDE_ALLOWED else os.path.dirname(folder) + os.sep
        self.found = ""

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and self.around and isinstance(arguments[0], str):
            path = os.path.abspath(arguments[0])
            if path.startswith(self.around) and not path.startswith(self.inside):
                self.found = path


def serve(requests: Connection, seen: Iterable[Line], readers: Mapping[str, Callable[[Path], Read]] = READERS) -> None:
    """Read what is asked for, (kind, folder, entry, size), and send an `Outcome` each, until the pipe closes."""
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("error")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 << 20, 64 << 20))
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    _load_usd()
    tracer, outside = LineTracer(seen), OpenedOutside()
    while True:
        try:
            kind, folder, entry, size = requests.recv()
        except EOFError:
            return
        os.chdir(folder)
        outside.watch(folder, kind)
        outcome = _watch(readers[kind], Path(folder) / entry, size, tracer)
        requests.send(replace(outcome, result="crash", detail=f"opened {outside.found}") if outside.found else outcome)


def _load_usd() -> None:
    """Load OpenUSD with its plugins and threads: they take more memory than any file may."""
    sdf, usd, geom = load_usd("Sdf"), load_usd("Usd"), load_usd("UsdGeom")
    stage = usd.Stage.CreateInMemory()
    geom.Xform.Define(stage, "/scene")
    for ending in ("usda", "usdc"):
        sdf.Layer.CreateAnonymous(f".{ending}").TransferContent(stage.GetRootLayer())
    geom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/scene"))


def _watch(reader: Callable[[Path], Read], path: Path, size: int, tracer: LineTracer) -> Outcome:
    gc.collect()
    gc.freeze()  # the next collection need not look at what stays
    limit = PER_BYTE * size + ALLOWANCE
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts afresh
    before = _memory("VmRSS")
    # What is asked for counts, not only what is touched: a machine may not have it.
    resource.setrlimit(resource.RLIMIT_AS, (_memory("VmSize") + limit, hard))
    result, detail, digest, reported = "read", "", "", ()
    started = time.perf_counter()
    tracer.start()
    try:
        found = reader(path)
        digest, reported = found.digest, found.reported
        if found.unreported:
            result, detail = "silent", found.unreported
    except InstDriveError as error:
        result, detail = "refused", f"{type(error).__name__}: {error}"[:500]
        if _find_origin(error, MemoryError):
            result, detail = "overallocation", "".join(traceback.format_exception(error))[-3000:]
    except MemoryError as error:
        result, detail = "overallocation", "".join(traceback.format_exception(error))[-3000:]
    except BaseException as error:
        result, detail = "crash", "".join(traceback.format_exception(error))[-3000:]
    lines = tracer.stop()
    seconds = time.perf_counter() - started
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
    peak = _memory("VmHWM") - before
    if Path(MARKER).exists():
        result, detail = "crash", "the file's code was run"
    elif peak > limit:
        result, detail = "overallocation", f"{peak / 1e6:.0f} MB for {size} bytes ({result})"
    return Outcome(result, detail, digest, reported, seconds, peak, lines)


def _find_origin(error: BaseException | None, kind: type[BaseException]) -> bool:
    while error is not None:
        if isinstance(error, kind) or kind.__name__ in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False


def _memory(field: str) -> int:
    """Bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(f"{field}:"))
