"""All that only a GPU can show, row by row within ten minutes; whatever fails, the other rows are measured.

`benchmarks/gpu_check.sh OUT.json` runs it. Each row is a process of its own with a time limit, so that neither a crash
nor a full memory of the GPU ends the others, and OUT.json is written anew after every row. A row's `status` is
`measured`, `failed` (with the reason) or `not measured` (without a GPU, say). The exit status is 1 where a row failed.

This file needs Python's own library only: what is broken on a machine shows as a row, not as a crash.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TOTAL_SECONDS = 600.0
"""The whole call takes no longer."""
LEAST_SECONDS = 5.0
"""A row that has less time left is not begun."""
MEASURED, FAILED, NOT_MEASURED = "measured", "failed", "not measured"

Result = dict[str, Any]
Run = Callable[[str, float, Mapping[str, str]], Result]
"""Runs a row by its name, within seconds, in an environment."""


@dataclass(frozen=True)
class Row:
    """One thing to find out."""

    name: str
    """That of a function in `gpu_rows.ROWS`."""
    seconds: float
    """Its time limit."""
    needs: str = ""
    """The row that has to be measured before this one means anything."""
    on_gpu: bool = True
    """Whether a machine without a GPU cannot run it."""


ROWS = (
    Row("machine", 60, on_gpu=False),
    Row("opengl", 30, on_gpu=False),
    Row("install", 90),
    Row("build", 300, needs="install"),
    Row("tests", 120, needs="build"),
    Row("resume", 60, needs="build"),
    Row("steps_1m", 60, needs="build"),
    Row("gsplat_1m", 60, needs="build"),
    Row("steps_5m", 90, needs="build"),
    Row("gsplat_5m", 90, needs="build"),
)
RATIOS = {"step_ratio_1m": ("steps_1m", "gsplat_1m"), "step_ratio_5m": ("steps_5m", "gsplat_5m")}
"""How many times longer our step takes than that of gsplat's trainer; the goal is 1.3 at most."""


def check(out: Path, run: Run, clock: Callable[[], float] = time.monotonic, total: float = TOTAL_SECONDS) -> Result:
    """Run all rows, write the report after each of them, and return it."""
    rows: dict[str, Result] = {}
    report, start = {}, clock()
    with tempfile.TemporaryDirectory() as folder:
        environment = extend_environment(os.environ, Path(folder))
        for row in ROWS:
            begun = clock()
            left = min(row.seconds, total - (begun - start))
            reason = explain_skipped(row, rows, left)
            print(f"{row.name} … ", end="", file=sys.stderr, flush=True)
            rows[row.name] = {"status": NOT_MEASURED, "reason": reason} if reason else run(row.name, left, environment)
            rows[row.name]["seconds"] = round(clock() - begun, 1)
            print(describe_row(rows[row.name]), file=sys.stderr)
            report = {"seconds": round(clock() - start, 1), **compare_steps(rows), "rows": rows}
            write_report(out, report)
    return report


def extend_environment(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """What rows find: gsplat in a folder that is deleted at the end, no state of the user's, only kernels that we call.

    gsplat from the source of GSPLAT_SOURCE, a folder, goes before an installed one.
    """
    paths = [environment.get("GSPLAT_SOURCE", ""), str(folder / "site"), str(ROOT), environment.get("PYTHONPATH", "")]
    return {
        "BUILD_3DGS": "1",  # with this named, gsplat 1.6 compiles nothing else
        "NUM_CHANNELS": "1,2,3,4,5,8,9,16,17,32",
        **environment,
        "GPU_CHECK_SITE": str(folder / "site"),
        "INSTDRIVE_STATE": str(folder / "state"),
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
    }


def explain_skipped(row: Row, rows: Mapping[str, Result], left: float) -> str:
    """Why the row is not begun; empty where it is."""
    machine = rows.get("machine", {})
    if row.on_gpu and machine.get("status") != MEASURED:
        return "what this machine has is not known: see the row 'machine'"
    if row.on_gpu and machine.get("no_gpu"):
        return f"no GPU: {machine['no_gpu']}"
    if row.needs and rows[row.needs]["status"] != MEASURED:
        return f"the row '{row.needs}' comes first: {rows[row.needs]['reason']}"
    return "the time is up" if left < LEAST_SECONDS else ""


def run_row(name: str, seconds: float, environment: Mapping[str, str]) -> Result:
    """Run one row in a process of its own. Its last line of output is the JSON of its figures."""
    command = [sys.executable, "-m", "benchmarks.gpu_rows", name]
    begun = subprocess.Popen(
        command, cwd=ROOT, env=dict(environment), stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        output, errors = begun.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(begun.pid, 9)  # compilers that it has started, too
        begun.communicate()
        return {"status": FAILED, "reason": f"not done within {seconds:.0f} s"}
    return read_result(begun.returncode, output.decode(errors="replace"), errors.decode(errors="replace"))


def read_result(code: int, output: str, errors: str) -> Result:
    """A row's figures, or how it failed, from its exit status and what it said."""
    lines = output.strip().splitlines()
    if code:
        said = (errors.strip() or output.strip() or "it said nothing").splitlines()
        return {"status": FAILED, "reason": f"exit status {code}: {said[-1]}", "output": said[-15:]}
    try:
        figures = json.loads(lines[-1])
        return {"status": MEASURED, **figures}
    except (IndexError, TypeError, ValueError):
        return {"status": FAILED, "reason": "its last line is no JSON object", "output": lines[-15:]}


def compare_steps(rows: Mapping[str, Result]) -> Result:
    """Our milliseconds a step over those of gsplat's trainer; None where one of them is missing."""
    ratios: Result = {}
    for name, (ours, theirs) in RATIOS.items():
        times = [rows[row]["ms_per_step"] for row in (ours, theirs) if "ms_per_step" in rows.get(row, {})]
        ratios[name] = round(times[0] / times[1], 2) if len(times) == 2 else None
    return ratios


def describe_row(result: Result) -> str:
    """One line for the terminal."""
    shown = {key: value for key, value in result.items() if key not in ("status", "output", "kernels")}
    return f"{result['status']}: {json.dumps(shown)}"


def write_report(path: Path, report: Result) -> None:
    """Replace the file at once: a killed call leaves the rows before."""
    new = path.with_name(path.name + ".new")
    new.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    new.replace(path)


def main(arguments: list[str] | None = None) -> int:
    """Check this machine; the exit status is 1 where a row failed, 2 where the report cannot be written."""
    parser = argparse.ArgumentParser(description="Check InstDrive on this machine's GPU, in at most ten minutes.")
    parser.add_argument("out", nargs="?", type=Path, default=Path("gpu_check.json"), help="the JSON file to write")
    out = parser.parse_args(arguments).out.resolve()
    if not out.parent.is_dir():
        parser.error(f"{out}: there is no folder {out.parent}; make it first")
    report = check(out, run_row)
    states = [row["status"] for row in report["rows"].values()]
    print(f"{out}: " + ", ".join(f"{states.count(state)} {state}" for state in (MEASURED, FAILED, NOT_MEASURED)))
    return int(FAILED in states)


if __name__ == "__main__":
    sys.exit(main())
