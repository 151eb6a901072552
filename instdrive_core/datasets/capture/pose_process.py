"""The process that `poses` starts: it reads its task from the standard input and prints lines of JSON."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path
from queue import SimpleQueue
from threading import Thread

from instdrive_core.datasets.capture.structure import build_sparse_model
from instdrive_core.errors import DataError


def _run() -> None:
    """Do the task, and print what came of it. Ends the process, without the farewells of libraries that may crash."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # libraries print what they like
    acknowledged: SimpleQueue[None] = SimpleQueue()
    task = json.loads(sys.stdin.readline())

    def watch() -> None:
        for _ in sys.stdin:
            acknowledged.put(None)
        os._exit(1)  # whoever asked is gone

    def tell(**values: object) -> None:
        out.write(json.dumps(values) + "\n")
        out.flush()

    def tell_stage(title: str, done: int, total: int) -> None:
        tell(stage=title, done=done, total=total)
        acknowledged.get()

    Thread(target=watch, daemon=True).start()
    folder, scratch, careful, skipped = Path(task["folder"]), Path(task["scratch"]), task["is_careful"], task["skipped"]
    try:
        how = task["names"], task["lens"], task["is_video"]
        found = build_sparse_model(folder, *how, scratch, tell_stage, careful, tuple(skipped))
    except MemoryError as error:
        tell(kind="memory", problem=str(error))
    except ImportError as error:
        tell(kind="import", problem=str(error))
    except DataError as error:
        tell(kind="data", path=str(error.path), problem=error.problem, remedy=error.remedy)
    except Exception as error:
        tell(kind="other", problem=f"{type(error).__name__}: {error}")
    else:
        tell(**(asdict(found) if found else {"photos": None}))
    os._exit(0)


if __name__ == "__main__":
    _run()
