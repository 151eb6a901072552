"""The log of a run: one JSON line per reported step, whole lines only, also after a kill or on a full disk."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from types import TracebackType

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.training.settings.events import Stage, StepDone


class RunLog:
    """Appends steps. Opening it drops the steps after a resumed run's checkpoint, which will be done again."""

    def __init__(self, path: Path, stage: Stage, iteration: int) -> None:
        self.path = path
        write_bytes(path, "".join(line + "\n" for line in _read_lines_up_to(path, stage, iteration)).encode())
        self._file = path.open("a", encoding="utf-8")

    def __enter__(self) -> RunLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._file.close()
        except OSError as failure:
            if error is None:
                raise self._describe_failure(failure) from failure

    def write(self, step: StepDone) -> None:
        """Append one line and hand it to the system. Raises DataError where it does not fit on the disk."""
        try:
            self._file.write(json.dumps(asdict(step)) + "\n")
            self._file.flush()
        except OSError as failure:
            raise self._describe_failure(failure) from failure

    def _describe_failure(self, failure: OSError) -> DataError:
        problem = f"the log cannot be written ({failure.strerror or failure})"
        return DataError(self.path, problem, "Free some space, then go on with --resume")


def _read_lines_up_to(path: Path, stage: Stage, iteration: int) -> list[str]:
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            step = json.loads(line)
        except json.JSONDecodeError:
            continue  # cut off by a kill
        if (step["stage"] == "instances", step["iteration"]) <= (stage == "instances", iteration):
            kept.append(line)
    return kept
