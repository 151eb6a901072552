"""No loss: `python -m benchmarks.no_loss --kills 300` prints one JSON line.

Processes are killed (SIGKILL) at random moments of saving a project, of autosaving and of exporting; then the old or
the new file must be there, whole, and recovery must give every edit made a second or more before. Disks fill up in the
middle of writing. Ten thousand random edits are saved and replayed, undone and redone, and every bit compared.

`whole`, `lost` and `torn` count what was found after each kill, `left_by_kills` temporary files that killed writers
left and `stale_temporaries` those that are still there after the next save; `autosave_lag_ms` is the age of the oldest
edit that a kill has cost.
"""

from __future__ import annotations

import json
import multiprocessing
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import tyro

from benchmarks.edit_street import build_edit_street
from benchmarks.kill_targets import ACKNOWLEDGED, TARGETS, Autosave, Target, TornError, prepare, run_until_killed
from benchmarks.random_edits import RandomEdits
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import save_scene
from instdrive_core.project.open import open_document
from instdrive_core.project.save import save_project

SPAN = 0.3
"""Seconds after the first file within which the writer is killed; some tens of files are written in that time."""
ACKNOWLEDGED_AGE = 1.0
"""Seconds after which an edit must survive."""
_START = 60.0
"""Seconds a process gets until its first file."""
_SAVED_NAMES = ("a.ply", "a.splat", "a.spz", "a.compressed.ply", "a.sibr.ply", "a", "a.instdrive")


@dataclass(frozen=True)
class Options:
    """How much is tried."""

    kills: int = 300
    """A third each of project saves, autosave and exports."""
    autosave_span: float = 2.0
    """Seconds of editing within which autosave is killed."""
    full_disks: int = 70
    edits: int = 10_000
    seed: int = 0


def kill_one(target: Target, folder: Path, after: float, counts: Counter[str]) -> None:
    """Start a writer, kill it `after` seconds, and count what is found as ``whole``, ``lost`` or ``torn``."""
    context = multiprocessing.get_context("forkserver")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=run_until_killed, args=(target, folder, sender), daemon=True)
    process.start()
    sender.close()
    if not receiver.poll(_START):
        raise SystemExit(f"{type(target).__name__} wrote nothing within {_START:g} s")
    time.sleep(after)
    process.kill()
    killed = time.monotonic()
    process.join()
    told = _describe(receiver)
    counts["left_by_kills"] += len(_temporaries(folder))
    try:
        found = target.found(folder)
    except (TornError, DataError) as error:
        counts["torn"] += 1
        print(f"{type(target).__name__}: {error}", file=sys.stderr)
    else:
        counts["whole" if _is_enough(target, found, told, killed, counts) else "lost"] += 1
    target.write_once(folder)
    counts["stale_temporaries"] += len(_temporaries(folder))


def _is_enough(target: Target, found: int, told: list[tuple[int, float]], killed: float, counts: Counter[str]) -> bool:
    """Whether the last acknowledged generation, or a later one, is there; of an autosave, all of a second before."""
    if not isinstance(target, Autosave):
        return found >= told[-1][0]
    missing = [killed - when for number, when in told if number > found]
    counts["autosave_lag_ms"] = max(counts["autosave_lag_ms"], round(1000 * max(missing, default=0)))
    return max(missing, default=0) < ACKNOWLEDGED_AGE


def _describe(receiver: Connection) -> list[tuple[int, float]]:
    told = []
    try:
        while True:
            told.append(ACKNOWLEDGED.unpack(receiver.recv_bytes()))
    except EOFError:
        return told


def _temporaries(folder: Path) -> list[Path]:
    return list(folder.rglob(".*.tmp"))


def kills(options: Options) -> Counter[str]:
    """Kill writers of each kind in turn."""
    rng, counts = random.Random(options.seed), Counter[str]()
    multiprocessing.get_context("forkserver").set_forkserver_preload(["benchmarks.kill_targets"])
    with tempfile.TemporaryDirectory() as name:
        prepare(folder := Path(name))
        for number in range(options.kills):
            kinds = list(TARGETS.values())[number % len(TARGETS)]
            target = kinds[number // len(TARGETS) % len(kinds)]
            span = options.autosave_span if isinstance(target, Autosave) else SPAN
            kill_one(target, folder, rng.uniform(0, span), counts)
    return counts


def full_disks(count: int, seed: int) -> int:
    """Write until a limit on the file's size is met; returns how often the old file stayed whole and nothing else."""
    rng, whole = random.Random(seed), 0
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_scene(folder / "street", build_edit_street())
        document, _ = open_document(folder / "street")
        edits = RandomEdits(document, str(folder / "street"), seed)
        for number in range(count):
            path = folder / "out" / _SAVED_NAMES[number % len(_SAVED_NAMES)]
            _save(path, document, seed)
            before = _contents(path)
            edits.apply_one()
            resource.setrlimit(resource.RLIMIT_FSIZE, (rng.randrange(max(map(len, before.values()))), hard))
            try:
                _save(path, document, seed + 1)
                print(f"{path.name} was written in spite of the limit", file=sys.stderr)
            except DataError as error:
                whole += _contents(path) == before and "Free some space" in error.remedy
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    return whole


def _save(path: Path, document: Document, seed: int) -> None:
    if path.suffix == ".instdrive":
        return save_project(path, document, {"seed": seed})
    scene = build_edit_street(seed, actors=0)
    scene.extra = {}
    return save_scene(path, scene)


def _contents(path: Path) -> dict[str, bytes]:
    """Every file of the folder, or the file and all that lies beside it under a similar name."""
    files = path.rglob("*") if path.is_dir() else [path, *path.parent.glob(f".{path.name}*")]
    return {str(file): file.read_bytes() for file in files if file.is_file()}


def replays(edits: int, seed: int) -> dict[str, object]:
    """Random edits, saved and reopened, undone and redone one by one; whether every bit is the same each time."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_scene(folder / "street", build_edit_street())
        save_scene(folder / "car", build_edit_street(seed=1, ground=0, cars=1, actors=1, per_car=20))
        document, _ = open_document(folder / "street")
        drawn = RandomEdits(document, str(folder / "car"), seed)
        digests, kinds = {0: fingerprint(document)}, Counter[str]()
        while document.history.cursor < edits:
            kinds[drawn.apply_one()] += 1
            digests[document.history.cursor] = fingerprint(document)
        save_project(folder / "a.instdrive", document)
        again, _ = open_document(folder / "a.instdrive")
        same_replay = fingerprint(again) == digests[edits]
        del again
        return {
            "edits": edits,
            "kinds": len(kinds),
            "splats": len(document.scene),
            "replay_equal": same_replay,
            "history_equal": _is_history_equal(document, digests),
        }


def _is_history_equal(document: Document, digests: dict[int, bytes]) -> bool:
    """Whether each step undone, then redone, gives the document of that moment."""
    for step in (document.undo, document.redo):
        while step() is not None:
            if fingerprint(document) != digests[document.history.cursor]:
                return False
    return True


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    counts = kills(options)
    return {
        "kills": options.kills,
        **{name: counts[name] for name in ("whole", "lost", "torn", "stale_temporaries", "left_by_kills")},
        "autosave_lag_ms": counts["autosave_lag_ms"],
        "full_disks": options.full_disks,
        "full_disks_whole": full_disks(options.full_disks, options.seed),
        **(replays(options.edits, options.seed) if options.edits else {}),
    }


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Options))))
