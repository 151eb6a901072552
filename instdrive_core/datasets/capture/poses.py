"""Poses of photos, found by a process of its own: pycolmap brings libraries that can end a whole program where an
environment mixes packages, and nothing but ending the process interrupts its longer steps.

The process gets its task as a line of JSON and answers with lines of JSON, each of which it wants acknowledged before
it goes on; it ends where nobody listens any more. The model comes as a folder of COLMAP's files.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from shutil import rmtree
from tempfile import mkdtemp
from threading import Thread
from typing import IO, Any

from instdrive_core.errors import DataError
from instdrive_core.extras import MissingExtraError

OnStage = Callable[[str, int, int], None]
"""Is told the title of a step, how much is done, and how much there is."""
_PROCESS = "instdrive_core.datasets.capture.pose_process"
_SCRATCH = ".poses-"
_STARTS = 12
"""Times that a process is started which crashes. pycolmap 4.2.1 reads memory that is not its own where corners of two
photos fit a plane (PoseLib's `relpose_6pt_shared_focal`). The next time pairs are matched one by one, so that each that
was matched is kept, and the pair that crashed is left out from then on."""
_HEARTBEAT = 0.25
"""Seconds after which `OnStage` is told the last news again, so that it may cancel meanwhile."""
_CLASH = (
    "Run the same command again, what was found is kept. If that does not help, install InstDrive into an environment "
    "of its own (python -m venv), with pip install 'instdrive[capture]': other packages may bring libraries that clash"
)
_MEMORY = (
    "Close other programs or take fewer photos (--most) or smaller ones, then run the same command again: what was "
    "found is kept"
)


class _EndedError(DataError):
    """The process ended without an answer, with this exit code or, negative, by this signal."""

    def __init__(self, folder: Path, code: int, said: str) -> None:
        super().__init__(folder, *_explain_end(code, said))
        self.code = code


@dataclass(frozen=True)
class FoundPoses:
    """What structure from motion made of the photos."""

    photos: int
    """Photos with a pose."""
    points: int
    error: float
    """Mean distance in pixels between points and where photos show them."""


def find_poses(folder: Path, names: list[str], lens: str, is_video: bool, on_stage: OnStage) -> FoundPoses:
    """Find poses of the photos `names` below ``images`` and write the largest model to ``sparse/0``.

    What `on_stage` raises ends the work at once; it is called several times a second.

    Raises DataError where no model comes about, or where pycolmap cannot be loaded, fails or crashes;
    ModuleNotFoundError without pycolmap.
    """
    require_capture_packages()
    task = {"folder": str(folder), "names": names, "lens": lens, "is_video": is_video}
    last, skipped = ("", 0, 0), list[int]()

    def remember(title: str, done: int, total: int) -> None:
        nonlocal last
        last = title, done, total
        on_stage(title, done, total)

    for start in range(1, _STARTS + 1):
        with _make_scratch(folder) as scratch:
            try:
                again = {"scratch": str(scratch), "is_careful": start > 1, "skipped": skipped}
                answer = _work(folder, task | again, scratch / "said.txt", remember)
            except _EndedError as ended:
                if start == _STARTS or not _is_crash(ended.code):
                    raise
                if start > 1 and last[0] == "matching photos":
                    skipped.append(last[1])
                continue
            if answer["photos"] is None:
                problem = "no poses could be found: too few corners of one photo are found again in others"
                remedy = "Take pictures while moving, sharp ones with much overlap, or use more of them (--most)"
                raise DataError(folder, problem, remedy)
            _move_model(scratch / "model", folder / "sparse" / "0")
            return FoundPoses(answer["photos"], answer["points"], answer["error"])
    raise AssertionError("the last start returns or raises")


def require_capture_packages() -> None:
    """Raise ModuleNotFoundError or MissingExtraError where pycolmap or OpenCV is not installed; neither is loaded."""
    if find_spec("pycolmap") is None:
        raise ModuleNotFoundError("No module named 'pycolmap'", name="pycolmap")
    if find_spec("cv2") is None:  # another extra, larger than what is needed here, brings it too
        raise MissingExtraError("this needs OpenCV, which is not installed. Run: pip install 'instdrive[capture]'")


@contextmanager
def _make_scratch(folder: Path) -> Iterator[Path]:
    """A folder for what is written meanwhile; those that killed programs left behind are removed."""
    for old in folder.glob(f"{_SCRATCH}*"):
        rmtree(old, ignore_errors=True)
    scratch = Path(mkdtemp(prefix=_SCRATCH, dir=folder))
    try:
        yield scratch
    finally:
        rmtree(scratch, ignore_errors=True)


def _work(folder: Path, task: dict[str, Any], said: Path, on_stage: OnStage) -> dict[str, Any]:
    """The answer of a process that does the task; what it complains of goes to the file `said`."""
    with said.open("wb") as complaints:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", _PROCESS],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            start_new_session=True,  # Ctrl+C is for this program, which ends the other one
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        answer = _listen(process.stdin, process.stdout, task, on_stage)
        if answer is None:
            raise _EndedError(folder, process.wait(), _read_end(said))
        if answer.get("kind") == "data":
            raise DataError(answer["path"], answer["problem"], answer["remedy"])
        if "problem" in answer:
            raise DataError(folder, *_explain_problem(answer))
        return answer
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        with suppress(OSError):
            process.stdin.close()


def _listen(stdin: IO[bytes], stdout: IO[bytes], task: dict[str, Any], on_stage: OnStage) -> dict[str, Any] | None:
    """The last line of a process, after its news were passed on; None where it ended without one."""
    lines: SimpleQueue[bytes] = SimpleQueue()

    def read() -> None:
        for line in stdout:
            lines.put(line)
        lines.put(b"")

    Thread(target=read, daemon=True).start()
    news = "finding features", 0, len(task["names"])
    _send(stdin, json.dumps(task))
    while True:
        try:
            line = lines.get(timeout=_HEARTBEAT)
        except Empty:
            on_stage(*news)
            continue
        if not line.endswith(b"\n"):
            return None
        answer = json.loads(line)
        if "stage" not in answer:
            return answer
        news = answer["stage"], answer["done"], answer["total"]
        on_stage(*news)
        _send(stdin, "")


def _send(stdin: IO[bytes], text: str) -> None:
    with suppress(OSError):  # where the process has ended, what it printed last tells more
        stdin.write(f"{text}\n".encode())
        stdin.flush()


def _explain_end(code: int, said: str) -> tuple[str, str]:
    """Problem and remedy for a process that ended without an answer."""
    how = f"by {_name_signal(-code)}" if code < 0 else f"with exit code {code}"
    problem = f"the process that finds poses (pycolmap) was ended {how}"
    if _is_killed(code):
        return f"{problem}; systems do that where memory runs out", _MEMORY
    return problem + (f", {_STARTS} times in a row" if _is_crash(code) else "") + (f": {said}" if said else ""), _CLASH


def _is_killed(code: int) -> bool:
    return os.name == "posix" and code == -signal.SIGKILL


def _is_crash(code: int) -> bool:
    """Whether the process ended by a fault of its own: a signal, or one of Windows' large codes."""
    return (code < 0 and not _is_killed(code) and code != -signal.SIGTERM) or code >= 0xC0000000


def _explain_problem(answer: dict[str, Any]) -> tuple[str, str]:
    """Problem and remedy for an error that the process has seen."""
    said, kind = " ".join(answer["problem"].split()).rstrip("."), answer["kind"]
    if kind == "memory":
        return "memory ran out while poses were looked for", _MEMORY
    if kind == "import":
        return f"pycolmap is installed but cannot be loaded ({said})", _CLASH
    return f"pycolmap failed ({said})", _CLASH


def _name_signal(number: int) -> str:
    try:
        return f"the signal {signal.Signals(number).name}"
    except ValueError:
        return f"signal {number}"


def _read_end(said: Path) -> str:
    """The last line that a process complained with, stack traces left out, 300 characters at most."""
    lines = said.read_bytes()[-8192:].decode("utf-8", "replace").splitlines()
    kept = [line for line in map(str.strip, lines) if line and not line.startswith(("***", "PC:", "@"))]
    return " ".join(kept[-1].split())[:300].rstrip(".") if kept else ""


def _move_model(source: Path, folder: Path) -> None:
    """Move the model's files; cameras last, as the folder is a clip from then on."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in sorted(source.iterdir(), key=lambda file: file.name == "cameras.bin"):
        file.replace(folder / file.name)
